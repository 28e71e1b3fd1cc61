"""Trials are kept one by one: the same command makes what is missing, and nothing that does not count is counted."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from experiments.faults import __main__ as program
from experiments.faults import registry
from experiments.faults.attack import Attack, Ground, Trial
from experiments.faults.commands import run_command
from experiments.faults.said import fault_of_ended
from experiments.faults.study import TRIALS, failures_of, make_trials, notes_of, table_of

made: list[int] = []


def drawn(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """Trials of which each third fails, and the fifth cannot be made."""
    for number in numbers:
        made.append(number)
        ending = "not run" if number == 5 else "failed" if number % 3 == 2 else "passed"
        yield Trial(number, f"drew {ground.chance(number).integers(1000)}", ending, "it said so", 0.5, 10.0 + number)


ATTACK = Attack(asks="nothing", usual=7, trials=drawn)


@pytest.fixture(autouse=True)
def nothing_made() -> None:
    made.clear()


def make(out: Path, number: int | None = None, seed: int = 0) -> list[Trial]:
    return make_trials({"drawn": ATTACK}, out, number, seed, lambda name, trial: None)["drawn"]


def test_the_same_command_makes_what_is_missing_alone(tmp_path: Path):
    first = make(tmp_path, 3)
    assert made == [0, 1, 2]
    again = make(tmp_path)
    assert made == [0, 1, 2, 3, 4, 5, 6]
    assert again[:3] == first
    assert make(tmp_path) == again
    assert made[7:] == [5]  # which could not be made


def test_a_study_that_is_stopped_goes_on_where_it_was(tmp_path: Path):
    def stop(name: str, trial: Trial) -> None:
        if trial.number == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_trials({"drawn": ATTACK}, tmp_path, None, 0, stop)
    make(tmp_path)
    assert made == [0, 1, 2, 3, 4, 5, 6]


def test_what_depends_on_something_else_or_is_damaged_is_made_again(tmp_path: Path):
    names = [trial.name for trial in make(tmp_path, 4)]
    assert [trial.name for trial in make(tmp_path, 4, seed=1)] != names
    assert made == 2 * [0, 1, 2, 3]
    files = sorted((tmp_path / TRIALS / "drawn").glob("*.json"))
    files[0].write_text("{")
    content = json.loads(files[1].read_text())
    content["made_by"]["program"] = "another"
    files[1].write_text(json.dumps(content))
    make(tmp_path, 4, seed=1)
    assert made[8:] == [0, 1]


def test_the_table_counts_what_was_made(tmp_path: Path):
    trials = {"drawn": make(tmp_path)}
    (row,) = table_of({"drawn": ATTACK}, trials)
    assert (row["trials"], row["passed"], row["failed"], row["not run"]) == (6, 5, 1, 1)
    assert (row["longest, s"], row["most memory, MB"]) == (0.5, 16)
    assert [line.split(":")[0] for line in failures_of(trials)] == ["drawn 2", "drawn 5"]
    assert "Seed 7." in notes_of(trials, 7)


def broken_commands(ground: Ground, numbers: Sequence[int]) -> Iterator[Trial]:
    """A command that is broken on purpose, and one that is not."""
    for number in numbers:
        code = "raise KeyError(5)" if number else "pass"
        ended = run_command(code, program=("-c",), longest_s=30.0)
        wrong = fault_of_ended(ended)
        yield Trial(number, code, "failed" if wrong else "passed", wrong, ended.wall_s)


def test_a_command_that_is_broken_is_counted_as_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    attack = Attack(asks="no traceback", usual=2, trials=broken_commands)
    monkeypatch.setattr(registry, "ATTACKS", {"broken": attack})
    monkeypatch.setattr(program, "ATTACKS", {"broken": attack})
    assert program.faults(tmp_path / "one", number=1) == 0
    assert program.faults(tmp_path / "out") == program.SOME_FAILED
    said = capsys.readouterr().out
    assert "broken 1: failed: raise KeyError(5): a traceback: KeyError: 5" in said
    assert program.faults(tmp_path / "out") == program.SOME_FAILED  # read again


def test_what_is_recorded_is_all_that_out_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    attacks = {"drawn": ATTACK, "other": Attack(asks="little", usual=2, trials=drawn)}
    kept = {}
    monkeypatch.setattr(registry, "ATTACKS", attacks)
    monkeypatch.setattr(program, "ATTACKS", attacks)
    monkeypatch.setattr(program, "keep", lambda study, name, rows, title, notes: kept.update({study: rows}))
    program.faults(tmp_path / "out", only=("drawn",))
    program.faults(tmp_path / "out", only=("other",), record=True)
    assert [(row["attack"], row["trials"], row["failed"]) for row in kept["faults"]] == [
        ("drawn", 6, 1),
        ("other", 2, 0),
    ]


def test_an_attack_that_is_not_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert program.faults(tmp_path, only=("nobody",)) == 2
    assert "expected some of failing_candidates, " in capsys.readouterr().err


def test_registry_s_attacks_have_trials():
    for attack in registry.ATTACKS.values():
        assert len(attack.numbers(None)) == attack.usual
        assert attack.most is None or len(attack.numbers(attack.most + 1)) == attack.most
        assert list(attack.numbers(2)) == [0, 1]
