"""Progress and summary for people at a terminal; where there is none, a plain line now and then."""

import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from jaxcalib.calibration.objective.accuracy import VEHICLE_LEVEL
from jaxcalib.calibration.result.result import CalibrationResult

STAGE_NAMES = {
    "initial_values": "initial values from the logs",
    "stage1": "Stage 1: inflows",
    "stage2_exploration": "Stage 2: which driver parameters matter",
    "stage2_optimisation": "Stage 2: values of driver parameters",
    "confirmation": "confirmation in SUMO",
    "final_errors": "errors on unseen seeds in SUMO",
    "validation": "runs in SUMO",
    "null": "SUMO with the calibrated values: what chance does",
    "atlas": "what each effect would do",
    "evidence": "what the logs say",
    "check": "the best explanations in SUMO",
    "refit": "the winner fitted once more",
    "report": "report",
}
PLAIN_INTERVAL_S = 30.0
MOST_SHARE = 0.99  # that is shown as done before the end
SUMO_WEIGHT = 25.0  # a SUMO run takes about as long as so many of the surrogate's


class TerminalProgress:
    """Shows stage, best accuracy so far and the time left."""

    def __init__(self, console: Console | None = None) -> None:
        """Prepare the bar; it writes to standard error."""
        self._console = console or Console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[best]}"), TimeElapsedColumn(),
            TextColumn("left:"), TimeRemainingColumn(elapsed_when_finished=False), console=self._console,
            disable=not self._console.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task("reading the case", total=None, best="")
        self._said_at = time.monotonic()
        self._best = ""
        self._stage = ""

    def __enter__(self) -> "TerminalProgress":
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the bar away."""
        self._bar.stop()

    def plan(self, num_surrogate_runs: int, num_sumo_runs: int) -> None:
        """Say how many runs there will be, about."""
        self._bar.update(self._task, total=num_surrogate_runs + SUMO_WEIGHT * num_sumo_runs)

    def stage(self, name: str) -> None:
        """Say that another stage begins."""
        self._stage = STAGE_NAMES.get(name, name)
        self._bar.update(self._task, description=self._stage)
        self._say()

    def surrogate_runs(self, num_runs: int) -> None:
        """Say that so many runs of the surrogate are done."""
        self._advance(num_runs)

    def sumo_runs(self, num_runs: int) -> None:
        """Say that so many runs of SUMO are done."""
        self._advance(SUMO_WEIGHT * num_runs)

    def best(self, accuracy: float) -> None:
        """Say how good the best candidate is by now."""
        self._best = f"accuracy {accuracy:.3f}"
        self._bar.update(self._task, best=self._best)

    def notes(self, lines: Sequence[str]) -> None:
        """Say what a user should know before the end."""
        for line in lines:
            self._console.print(f"note: {line}", highlight=False, markup=False)

    def _advance(self, amount: float) -> None:
        task = self._bar.tasks[0]
        if task.total:  # about so many runs: some parts need more, and nothing is done before it is
            amount = max(0.0, min(amount, MOST_SHARE * task.total - task.completed))
        self._bar.advance(self._task, amount)
        if time.monotonic() - self._said_at > PLAIN_INTERVAL_S:
            self._say()

    def _say(self) -> None:
        """Write a plain line where no bar can be shown."""
        self._said_at = time.monotonic()
        if not self._console.is_terminal:
            task = self._bar.tasks[0]
            share = f"{task.completed / task.total:4.0%}" if task.total else "    "
            self._console.print(f"{share} {self._stage} {self._best}".rstrip(), highlight=False)


def summary(result: CalibrationResult, out: Path) -> str:
    """Return the few lines that a person wants to read first."""
    lines = ["", f"{'parameter':24s}{'scenario':>12s}{'calibrated':>12s}   90 % interval"]
    for name, one in result.parameter_table.items():
        interval = f"{one.lower:.4g} to {one.upper:.4g}" if one.lower is not None else "not identified"
        lines.append(f"{name:24s}{one.scenario:12.4g}{one.value:12.4g}   {interval} {one.unit}")
    role = "held_out" if result.moes["calibrated"].get("held_out") else "fit"
    lines += ["", f"errors in SUMO, {role.replace('_', '-')} drives:", f"{'':34s}before   after   noise floor"]
    for name, after in result.moes["calibrated"][role].items():
        before, floor = result.moes["no_calibration"][role].get(name), result.moes["noise_floor"][role].get(name)
        lines.append(f"  {name:32s}{_percent(before)} {_percent(after)}   {_percent(floor)}")
    totals = result.vehicle_level_error
    lines.append(
        f"  {f'vehicle level (sum of {len(VEHICLE_LEVEL)})':32s}"
        + " ".join(_percent(totals[kind].get(role, {}).get("value")) for kind in ("no_calibration", "calibrated"))
        + f"   {_percent(totals['noise_floor'].get(role, {}).get('value'))}"
    )
    lines += [*(f"warning: {line}" for line in result.warnings), "", f"report: {out / 'report.html'}"]
    return "\n".join(lines)


def _percent(value: float | None) -> str:
    return "      -" if value is None else f"{100.0 * value:6.1f}%"
