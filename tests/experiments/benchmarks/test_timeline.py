"""A command second by second: what its processes did, and under which of its stages it counts."""

import os
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from experiments.benchmarks.timeline import BEGINNING, Second, by_stage, coarser, draw, processor_times, stage_of

SECONDS = [
    Second(1.0, BEGINNING, 1.0, 0.9, 0.0),
    Second(2.5, "Stage 1", 1.5, 1.5, 0.75),
    Second(3.0, "Stage 1", 0.5, 0.1, 0.75),
    Second(4.0, "confirmation in SUMO", 1.0, 0.25, 1.75),
]


def test_times_of_a_stage_are_pooled_and_what_is_left_of_the_cores_is_idle() -> None:
    rows = by_stage(SECONDS, 2)
    assert [row["stage"] for row in rows] == [BEGINNING, "Stage 1", "confirmation in SUMO"]
    assert [row["time_s"] for row in rows] == [1.0, 2.0, 1.0]
    assert rows[1]["cores_of_command"] == pytest.approx(0.8)  # 1.6 s of a processor in 2 s
    assert rows[1]["cores_of_sumo"] == pytest.approx(0.75)
    assert rows[1]["idle_cores"] == pytest.approx(0.45)
    assert rows[2]["idle_cores"] == 0.0


def test_the_last_line_of_progress_names_the_stage() -> None:
    said = ["  0% initial values from the logs", "  7% Stage 1: demand accuracy -3.237", "a warning with 5% in it"]
    assert stage_of(said) == "Stage 1: demand"
    assert stage_of(["5 of 20 runs"]) == BEGINNING


def test_processor_time_of_a_process_grows_while_it_works() -> None:
    me = psutil.Process(os.getpid())
    before = processor_times(me)[os.getpid()]
    until = time.process_time() + 0.2
    while time.process_time() < until:
        pass
    assert processor_times(me)[os.getpid()] >= before + 0.1


def test_the_picture_names_every_stage(tmp_path: Path) -> None:
    draw(SECONDS, 2, tmp_path / "timeline.svg")
    text = (tmp_path / "timeline.svg").read_text(encoding="utf-8")
    assert all(second.stage in text for second in SECONDS)


def test_a_picture_of_a_long_command_has_few_columns_and_all_of_its_work() -> None:
    seconds = [Second(0.5 + i, "first" if i < 7 else "second", 1.0, 0.1 * i, 0.01 * i) for i in range(23)]
    spans = coarser(seconds, most=6)
    assert [(span.stage, span.length_s) for span in spans] == [
        ("first", 4.0), ("first", 3.0), ("second", 4.0), ("second", 4.0), ("second", 4.0), ("second", 4.0),
    ]  # fmt: skip
    assert spans[0].end_s == 3.5
    assert spans[-1].end_s == seconds[-1].end_s
    assert sum(span.command_s for span in spans) == pytest.approx(sum(second.command_s for second in seconds))
    assert sum(span.sumo_s for span in spans) == pytest.approx(sum(second.sumo_s for second in seconds))
    assert coarser(seconds, most=23) == seconds


def test_a_process_that_ends_while_it_is_asked_hides_no_other() -> None:
    """Else what the others did since they began would count as done in the second after."""

    class Ended:
        pid = 7

        def cpu_times(self) -> Any:
            raise psutil.NoSuchProcess(self.pid)

    def running(pid: int, user: float) -> SimpleNamespace:
        return SimpleNamespace(pid=pid, cpu_times=lambda: SimpleNamespace(user=user, system=0.5))

    root: Any = running(5, 1.0)
    root.children = lambda recursive: [Ended(), running(9, 2.0)]
    assert processor_times(root) == {5: 1.5, 9: 2.5}
