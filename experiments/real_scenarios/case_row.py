"""One case from its folder to a row of the table: checked, calibrated, and its result read."""

import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxcalib.calibration.confirmation.agreement import LEAST_SHARE
from jaxcalib.calibration.objective.accuracy import TRAFFIC_LEVEL, VEHICLE_LEVEL_SUM
from jaxcalib.case.case import Role
from jaxcalib.check.scenario_check import check_case
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from sim_adapters.scenario.finding import Level

TRAFFIC_LEVEL_MEAN = "traffic_level"  # over the errors of Eqs. 33-36 that there are


@dataclass(frozen=True)
class CaseRow:
    """What came of one case."""

    name: str  # its folder's name
    ending: str  # "result", "refused" or "failed"
    words: str = ""  # why it was refused or failed, or why SUMO made the search's runs
    check_s: float = float("nan")  # time of `jaxcalib check`'s work
    calibrate_s: float = float("nan")  # time of the calibration
    in_sumo: bool = False  # whether SUMO made the search's runs
    # held-out errors (of the drives to fit where none is held out) by name: before, after, noise floor, its 95 %
    # quantile
    errors: Mapping[str, tuple[float, float, float, float]] | None = None
    # share of sections in which the surrogate's speed is within the tolerance of SUMO's, where the search begins: at
    # the last point compared, for a point is left only for one that the logs speak for. None where it was not asked.
    share_alike: float | None = None

    def is_better(self, name: str) -> bool:
        """Whether an error is lower than before, or at its noise floor."""
        if self.errors is None:
            return False
        before, after, _, high = self.errors[name]
        return after < before or after <= high

    @property
    def is_followed_or_left(self) -> bool:
        """Whether the surrogate is within the tolerance in nine tenths of the sections, or SUMO ran alone and why."""
        return (self.in_sumo and bool(self.words)) or (self.share_alike is not None and self.share_alike >= LEAST_SHARE)


def run_case(case: Path, out: Path, budget: float) -> CaseRow:
    """Check and calibrate one case in a process of its own, or go on with what is there.

    Args:
        case: its folder.
        out: where RUN goes, and what the calibration says.
        budget: factor on the numbers of runs.
    """
    began_s = time.perf_counter()
    try:
        reasons = [str(one) for one in check_case(case).findings if one.level is Level.SUMO_ALONE]
    except Exception as error:  # whatever goes wrong in one case, the others are run
        return CaseRow(case.name, "refused", f"{type(error).__name__}: {error}", time.perf_counter() - began_s)
    check_s = time.perf_counter() - began_s
    run, said = out / case.name, out / f"{case.name}.log"
    if not (run / "result.json").is_file():
        options = ["--out", str(run), "--budget", f"{budget:g}", *(["--resume"] if run.exists() else [])]
        command = [sys.executable, "-m", "jaxcalib", "calibrate", str(case), *options]
        with said.open("w", encoding="utf-8") as log:
            code = subprocess.run(command, stderr=log, stdout=log, check=False).returncode
        if code:
            last = (said.read_text(encoding="utf-8").strip().splitlines() or [""])[-1]
            return CaseRow(case.name, "refused" if code == EXIT_CASE_WRONG else "failed", last, check_s)
    return read_row(case.name, json.loads((run / "result.json").read_text(encoding="utf-8")), check_s, reasons)


def read_row(name: str, result: Mapping[str, Any], check_s: float, reasons: Sequence[str]) -> CaseRow:
    """Return the row of a calibrated case.

    Args:
        name: of the case.
        result: result.json.
        check_s: time of the check.
        reasons: what the surrogate cannot follow, one line each.
    """
    confirmation = result["confirmation"]
    agreement = confirmation["agreement"]
    apart = [f"{each['share_alike']:.0%} of sections alike {each['where']}" for each in agreement if not each["holds"]]
    role: Role = "held_out" if result["moes"]["calibrated"].get("held_out") else "fit"
    return CaseRow(
        name=name,
        ending="result",
        words="; ".join([*reasons[:1], *apart]),
        check_s=check_s,
        calibrate_s=result["wall_s"]["total"],
        in_sumo=confirmation["searched_in_sumo"],
        errors={VEHICLE_LEVEL_SUM: _vehicle_level(result, role), TRAFFIC_LEVEL_MEAN: _traffic_level(result, role)},
        share_alike=agreement[-1]["share_alike"] if agreement else None,
    )


def _vehicle_level(result: Mapping[str, Any], role: Role) -> tuple[float, float, float, float]:
    errors = result["vehicle_level_error"]
    floor = errors["noise_floor"][role]
    before, after = (errors[kind][role]["value"] for kind in ("no_calibration", "calibrated"))
    return _numbers(before, after, floor["value"], floor["quantile_95"])


def _traffic_level(result: Mapping[str, Any], role: Role) -> tuple[float, float, float, float]:
    tables = (
        result["moes"]["no_calibration"][role],
        result["moes"]["calibrated"][role],
        result["moes"]["noise_floor"][role],
        result["noise_floor_high"][role],
    )
    known = [name for name in TRAFFIC_LEVEL if all(table.get(name) is not None for table in tables)]
    return _numbers(*(float(np.mean([table[name] for name in known])) if known else None for table in tables))


def _numbers(*values: float | None) -> tuple[float, float, float, float]:
    before, after, floor, high = (float("nan") if value is None else float(value) for value in values)
    return before, after, floor, high
