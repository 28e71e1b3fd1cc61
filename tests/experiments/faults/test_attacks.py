"""Attacks find what they look for, and do what they say."""

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.faults import failing_candidates, soak
from experiments.faults.attack import Ground
from experiments.faults.hostile import files
from experiments.faults.hostile.names import SCRIPT
from experiments.faults.hostile.place import Place
from experiments.faults.hostile.trials import HOSTILE, complaint_of
from experiments.faults.hostile.watched import watch
from experiments.faults.mutated_cases.checker import check
from experiments.faults.mutated_cases.spoiling import spoil_case
from experiments.faults.said import fault_of
from experiments.optimisers.registry import OPTIMISERS
from jaxcalib.cli import app
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told

LONGEST_S = 60.0


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("faults")
    return Ground(folder / "attack", folder / "case", 0).case


class Boaster(Optimiser):
    """Random search that calls the candidate before the last the best, whatever became of it."""

    def init(self, setting: Setting) -> np.random.Generator:
        return np.random.default_rng(setting.seed)

    def ask(self, state: np.random.Generator) -> np.ndarray:
        return np.random.default_rng(state.bit_generator.random_raw()).random((8, failing_candidates.NUM_PARAMETERS))

    def tell(self, state: np.random.Generator, told: Told) -> tuple[np.random.Generator, RoundInfo]:
        return state, RoundInfo(int((~told.is_ok).sum()), best=told.points[-2])


@pytest.mark.parametrize("how", [failing_candidates.BY_CHANCE, failing_candidates.BY_PLACE])
def test_an_optimiser_whose_best_has_failed_is_found(how: str):
    ending, words = failing_candidates.try_optimiser(Boaster, 0.5, how, np.random.default_rng(3))
    assert ending == "failed"
    assert "its best" in words


@pytest.mark.parametrize("how", [failing_candidates.BY_CHANCE, failing_candidates.BY_PLACE])
def test_an_optimiser_that_is_sound_passes_and_candidates_have_failed(how: str):
    ending, words = failing_candidates.try_optimiser(OPTIMISERS["random"], 0.2, how, np.random.default_rng(3))
    assert ending == "passed"
    assert 20 < int(words.split()[0]) < 90  # of 240, of which a fifth is to fail


def test_no_failure_is_no_trial():
    ending, _ = failing_candidates.try_optimiser(OPTIMISERS["random"], 0.0, "by chance", np.random.default_rng(3))
    assert ending == "not run"


def test_a_seed_decides_what_is_spoilt_and_something_always_is(case: Path, tmp_path: Path):
    ground = Ground(tmp_path / "mutated_cases", case, 5)
    sound = {file.name: file.read_bytes() for file in case.rglob("*") if file.is_file()}
    words = []
    for number in range(25):
        found = [spoil_case(case, tmp_path / f"{copy}-{number}", ground.chance(number)) for copy in range(2)]
        assert found[0] == found[1]
        assert found[0][1]
        words.append(found[0][0])
        spoilt = {file.name: file.read_bytes() for file in (tmp_path / f"0-{number}").rglob("*") if file.is_file()}
        assert spoilt != sound
    assert len(set(words)) == len(words)


def test_a_check_that_fails_is_a_fault_and_one_that_works_is_none(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    page = tmp_path / "check.html"
    sound = check(case, page)
    assert fault_of(sound.code, sound.err) == ""
    assert page.is_file()
    assert sound.cpu_s > 0.0
    assert sound.peak_mb > 50.0
    spoilt = Path(shutil.copytree(case, tmp_path / "case"))
    (spoilt / "case.toml").write_text("format = 3\n")
    refused = check(spoilt, page)
    assert refused.code == 2
    assert fault_of(refused.code, refused.err, may_say_more=True, files=["case.toml"]) == ""
    assert refused.err.count("case.toml: ") == 3  # the format, and what is missing

    def break_down(*arguments: Any, **options: Any) -> int:
        raise KeyError("vType")

    monkeypatch.setattr(app, "check", break_down)
    broken = check(case, page)
    assert fault_of(broken.code, broken.err) == "a traceback: KeyError: 'vType'"


@pytest.fixture
def place(case: Path, tmp_path: Path) -> Place:
    place = Place(tmp_path / "ground" / "hostile" / "00000")
    shutil.copytree(case, place.case)
    place.outside.mkdir()
    return place


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_case_is_another_one(name: str, case: Path, place: Place, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(files, "BOMB_BYTES", 4 << 20)
    monkeypatch.setattr(files, "NUM_BOMB_ROWS", files.ROWS_PER_PIECE)

    def content(folder: Path) -> dict[str, bytes]:
        return {
            str(one.relative_to(folder)): one.read_bytes() if one.is_file() and one.stat().st_size else b""
            for one in folder.rglob("*")
        }

    HOSTILE[name](place)
    assert content(place.case) != content(case)


def no_harm(place: Place) -> str:
    return "pass"


def write_outside(place: Place) -> str:
    return f"open({str(place.outside / 'x')!r}, 'w').write('x')"


def change_the_case(place: Place) -> str:
    return f"open({str(place.toml)!r}, 'a').write('x')"


def write_beside(place: Place) -> str:
    return f"open({str(place.folder.parent / 'x')!r}, 'w').write('x')"


def leave_scratch(place: Place) -> str:
    return "import tempfile; tempfile.mkdtemp()"


def open_a_port(place: Place) -> str:
    return "import socket; one = socket.socket(); one.bind(('127.0.0.1', 0)); one.listen()"


def raw_markup(place: Place) -> str:
    return f"open({str(place.run / 'x.html')!r}, 'w').write({SCRIPT!r})"


def control(place: Place) -> str:
    return "print('\\x1b[2J')"


def tell_secrets(place: Place) -> str:
    return "print(open('/etc/passwd').read()[:20])"


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (no_harm, ""),
        (write_outside, "written outside RUN: outside/x"),
        (change_the_case, "written outside RUN: case/case.toml"),
        (write_beside, "written outside RUN: hostile/x"),
        (leave_scratch, "written outside RUN: tmp/"),
        (open_a_port, "sockets: "),
        (raw_markup, "x.html holds raw markup"),
        (control, "control characters"),
        (tell_secrets, "file of others"),
    ],
)
def test_harm_is_seen(harm: Callable[[Place], str], words: str, place: Place):
    watched = watch(place, harm(place), longest_s=LONGEST_S, program=("-c",))
    assert watched.ended.code == 0, watched.ended.err
    complaint = complaint_of(place, watched, is_check=False)
    assert words in complaint if words else complaint == ""
    assert complaint_of(place, replace(watched, written=["a"], sockets=[]), is_check=False).endswith("RUN: a")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"last_mb": 530.0}, "memory grows"),
        ({"last_mb": 300.0}, ""),
        ({"compilations": 1}, "compiles on"),
        ({"failed": 1}, "1 runs failed"),
        ({"compilations_before": 0}, "no compilation was heard of"),
        ({"rounds": 40}, "40 rounds of 60"),
    ],
)
def test_what_long_use_may_take(changes: dict[str, float], words: str):
    found = {
        "rounds": 60,
        "failed": 0,
        "settled_mb": 500.0,
        "last_mb": 520.0,
        "compilations": 0,
        "compilations_before": 3,
    } | changes
    wrong, _ = soak.judged(found, 60, compiles=True)
    assert words in wrong if words else wrong == ""


def test_python_itself_opens_no_socket_at_its_start(place: Place):
    """So that what is seen is the command's own."""
    watched = watch(place, "import multiprocessing, asyncio", longest_s=LONGEST_S, program=("-c",))
    assert (watched.ended.code, watched.sockets, watched.written) == (0, [], []), sys.version
