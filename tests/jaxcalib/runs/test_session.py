"""A session opens RUN, gives seeds and times, and leaves nothing behind where nothing is to be kept."""

from pathlib import Path

import pytest

from jaxcalib.errors import CaseError
from jaxcalib.runs import seeds
from jaxcalib.runs.session import open_session

IDENTITY = {"case": "toy 1", "options": "{}", "program": "2"}


def test_without_a_folder_nothing_is_left_behind():
    with open_session(None, IDENTITY, seed=3) as session:
        path = session.folder.path
        assert path.is_dir()
        session.progress.stage("any")  # nobody is told, and nothing fails
    assert not path.exists()


def test_seeds_of_two_values_of_seed_never_meet():
    with open_session(None, IDENTITY, seed=2) as session:
        assert session.first_seed == 2 * seeds.SEEDS_PER_CALIBRATION
    bases = [value for name, value in vars(seeds).items() if name.endswith("_SEED") and name != "MOST_SEED"]
    bases += seeds.FINAL_SEEDS.values()
    assert len(set(bases)) == len(bases)
    assert max(bases) < seeds.SEEDS_PER_CALIBRATION
    assert (seeds.MOST_SEED + 1) * seeds.SEEDS_PER_CALIBRATION < 2**31  # SUMO's seeds are signed 32-bit numbers


def test_a_folder_is_kept_and_gone_on_with_only_where_that_is_asked_for(tmp_path: Path):
    with open_session(tmp_path / "run", IDENTITY) as session:
        session.folder.write_text("found.txt", "7")
    with pytest.raises(CaseError, match="--resume"), open_session(tmp_path / "run", IDENTITY):
        pass
    with open_session(tmp_path / "run", IDENTITY, resume=True) as session:
        assert (session.folder.path / "found.txt").read_text() == "7"


def test_parts_that_are_timed_apart_do_not_count_in_the_session():
    with open_session(None, IDENTITY) as session:
        apart = session.timed_apart()
        with session.stopwatch.time("refit"), apart.stopwatch.time("stage1"):
            pass
        assert set(session.stopwatch.wall_s) == {"refit"}
        assert set(apart.stopwatch.wall_s) == {"stage1"}
        assert apart.journal is session.journal
        assert session.elapsed_s > session.stopwatch.wall_s["refit"]


def test_a_refusal_names_the_options_that_differ(tmp_path: Path):
    begun = IDENTITY | {"options": '{"budget": 0.5, "seed": 3, "settings": "a long text"}'}
    with open_session(tmp_path / "run", begun):
        pass
    now = IDENTITY | {"options": '{"budget": 1.0, "engine": "sumo", "seed": 3, "settings": "a long text"}'}
    with pytest.raises(CaseError) as refused, open_session(tmp_path / "run", now, resume=True):
        pass
    assert '(budget 0.5, not 1.0, engine None, not "sumo"); name another' in str(refused.value)
