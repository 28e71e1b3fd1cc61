"""Rounds of simulated drives: as much traffic as the field has recorded, as on another day."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.runs.seeds import VALIDATION_SEED
from jaxcalib.validation.calibrated_run import CalibratedRun
from jaxcalib.validation.prediction import FEWEST_ROUNDS
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest


def round_requests(
    calibrated: CalibratedRun, starts: Sequence[DriveStart], seeds: int, after: int = 0
) -> list[RunRequest]:
    """Return the runs of all rounds: each drive once in each, no two with the same seed, after so many other seeds."""
    first = calibrated.first_seed + VALIDATION_SEED + after
    return [
        RunRequest(calibrated.values, first + number * len(starts) + place, own.depart_s, drive=own.drive)
        for number in range(seeds)
        for place, own in enumerate(starts)
    ]


def complete_rounds(outcomes: Sequence[RunOutcome], num_drives: int) -> np.ndarray:
    """Return what the rounds in which no run failed have observed, [round, drive, number].

    Raises:
        AllRunsFailedError: too few of them are left.
    """
    return np.asarray([[run.observed for run in runs] for runs in runs_of_rounds(outcomes, num_drives)], float)


def runs_of_rounds(outcomes: Sequence[RunOutcome], num_drives: int) -> list[Sequence[RunOutcome]]:
    """Return the runs of the rounds in which none failed, a drive's in its place.

    Raises:
        AllRunsFailedError: too few of them are left.
    """
    rounds = [outcomes[begin : begin + num_drives] for begin in range(0, len(outcomes), num_drives)]
    complete = [runs for runs in rounds if all(run.status.is_ok for run in runs)]
    if len(complete) < FEWEST_ROUNDS:
        reasons = "; ".join(sorted({run.status.value for run in outcomes if not run.status.is_ok}))
        tail = next((run.log_tail for run in outcomes if run.log_tail), "")
        raise AllRunsFailedError(f"in all but {len(complete)} rounds of drives a run failed in SUMO: {reasons}", tail)
    return complete
