"""What attacks put around the program is as they say, and what they compare is compared as a whole."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.faults import broken_jobs, determinism, disk, kills
from experiments.faults.altered import MODULE, Alterations
from experiments.faults.attack import Ground
from experiments.faults.commands import Started, run_command
from experiments.faults.small_commands import COMMANDS, Result, difference, differing_rows, digest_of, statuses
from experiments.faults.small_disk import NoDiskError, SmallDisk, small_disk

LONGEST_S = 60.0


def swept(folder: Path, **changes: list[Any]) -> Result:
    rows = {"candidate": [0, 0, 1], "seed": [0, 1, 0], "depart_s": [60.0] * 3, "status": ["OK", "OK", "FAILED"]}
    folder.mkdir(exist_ok=True)
    table = pd.DataFrame(rows | {"wall_s": [0.1, 0.2, 0.3], "speed_mps": [20.1, 20.2, 20.3]} | changes)
    table.to_parquet(folder / COMMANDS["sweep"].file)
    return COMMANDS["sweep"].result(folder)


def test_tables_are_equal_but_for_times(tmp_path: Path):
    one = swept(tmp_path)
    assert difference(swept(tmp_path, wall_s=[9.0, 8.0, 7.0]), one) == ""
    other = swept(tmp_path, speed_mps=[20.1, 20.2 + 1e-12, 20.3])
    assert difference(other, one).startswith("1 of 4 parts differ, first row 1: ")
    assert digest_of(other) != digest_of(one)
    assert differing_rows(other, one) == ["row 1"]
    assert statuses(other, ["row 1", "row 2"]) == {"OK", "FAILED"}


def test_rows_that_are_missing_or_doubled_are_seen(tmp_path: Path):
    one = swept(tmp_path)
    assert COMMANDS["sweep"].num_doubled(tmp_path) == 0
    swept(tmp_path, seed=[0, 0, 0])
    assert COMMANDS["sweep"].num_doubled(tmp_path) == 1
    fewer = {name: text for name, text in one.items() if name != "row 2"}
    assert "row 2" in difference(fewer, one)
    assert "row 2" in difference(one, fewer)


def test_results_are_equal_but_for_times(tmp_path: Path):
    results = []
    for tau, wall_s in ((1.5, 10.0), (1.5, 20.0), (1.6, 10.0)):
        content = {"parameters": {"tau": tau}, "wall_s": wall_s, "profile": None, "timing": {"search_s": wall_s}}
        (tmp_path / "result.json").write_text(json.dumps(content))
        results.append(COMMANDS["calibrate"].result(tmp_path))
    assert difference(results[1], results[0]) == ""
    assert "parameters" in difference(results[2], results[0])


def test_one_job_of_so_many_is_befallen_and_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(broken_jobs, "run_job", lambda job: f"run {job.seed}")
    jobs = [SimpleNamespace(seed=seed) for seed in range(40)]
    answers = [broken_jobs.spoilt_job("nothing", 20, 7, tmp_path, job) for job in jobs]
    assert [place for place, answer in enumerate(answers) if answer is None] == [7, 27]
    assert answers[8] == "run 8"
    notes = [json.loads((tmp_path / f"befallen-{number}.json").read_text()) for number in (7, 27)]
    assert [(note["seed"], note["process"]) for note in notes] == [(7, os.getpid()), (27, os.getpid())]


def test_an_altered_program_believes_what_it_is_told(tmp_path: Path):
    file = Alterations(cores=3).write(tmp_path / "alterations.json")
    code = (
        "import os, sys; from experiments.faults import altered; from jaxcalib.cli import app;"
        "app.main = lambda: print(len(os.sched_getaffinity(0)), *sys.argv[1:]);"
        f"sys.argv = ['altered', {str(file)!r}, 'check', 'CASE']; altered.main()"
    )
    ended = run_command(code, program=("-c",), longest_s=LONGEST_S)
    assert ended.out == "3 check CASE\n", ended.err
    refused = run_command(file, "check", tmp_path / "nowhere", program=MODULE, longest_s=LONGEST_S)
    assert (refused.code, refused.err.startswith("jaxcalib: ")) == (2, True)


def test_numbers_with_decimal_commas(tmp_path: Path):
    environment = determinism.german_environment(tmp_path / "locale")
    if environment is None:
        pytest.skip("no such locale, nor what makes it")
    code = "import ctypes, locale; locale.setlocale(locale.LC_ALL, ''); b = ctypes.create_string_buffer(9);"
    code += "ctypes.CDLL(None).snprintf(b, 9, b'%.1f', ctypes.c_double(1.5)); print(b.value.decode())"
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True)
    assert done.stdout == "1,5\n"


@pytest.fixture
def own_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    try:
        with small_disk(tmp_path / "disk", 1 << 17) as mounted:
            yield mounted
    except NoDiskError as error:
        pytest.skip(str(error))


def test_a_small_disk_becomes_full_and_grows(own_disk: SmallDisk):
    place = disk.full(own_disk)
    with pytest.raises(OSError, match="No space left"):
        place.write_bytes(b"x" * 5000)
    place.unlink()
    own_disk.grow(1 << 20)
    place.write_bytes(b"x" * 5000)


def write_result(place: Path) -> None:
    place.mkdir(parents=True)
    (place / "result.json").write_bytes(b"x" * 5000)


@pytest.mark.parametrize("name", disk.PLACES)
def test_nothing_can_be_written_to_wrong_places(name: str, own_disk: SmallDisk):
    place = disk.PLACES[name](own_disk)
    with pytest.raises(OSError, match=r"Read-only|No space left|File exists|Not a directory"):
        write_result(place)


def test_ground_draws_by_seed_attack_and_number_alone(tmp_path: Path):
    def draw(seed: int, name: str, number: int) -> int:
        return int(Ground(tmp_path / name, tmp_path / "case", seed).chance(number).integers(1 << 40))

    assert draw(1, "kills", 2) == draw(1, "kills", 2)
    assert len({draw(1, "kills", 2), draw(2, "kills", 2), draw(1, "soak", 2), draw(1, "kills", 3)}) == 4
    ground = Ground(tmp_path / "kills", tmp_path / "case", 0)
    (ground.fresh("a") / "x").write_text("y")
    assert not list(ground.fresh("a").iterdir())
    shutil.rmtree(ground.folder)


@pytest.mark.parametrize(("seconds", "killed"), [(30.0, True), (0.0, False)])
def test_a_command_is_killed_or_ends_before(seconds: float, killed: bool, monkeypatch: pytest.MonkeyPatch):
    def started(words: list[str | Path]) -> Started:
        return Started(words, program=("-c", f"import time; time.sleep({seconds})"))

    monkeypatch.setattr(kills, "Started", started)
    latest_s = 1.0 if killed else 60.0
    found = [kills.killed_at_random([], np.random.default_rng(seed), latest_s) for seed in range(3)]
    assert [bool(one.moments_s) for one in found] == [killed] * 3
    assert [one.wrong for one in found] == [""] * 3
    assert all(len(one.moments_s) <= kills.MOST_KILLS for one in found)
    assert all(one.wall_s < 30.0 for one in found)
