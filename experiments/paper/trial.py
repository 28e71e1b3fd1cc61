"""One method on one traffic pattern with one seed: what the tables and figures are made from."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from jaxcalib.calibration.objective.accuracy import MOES
from jaxcalib.errors import CaseError

FORMAT = 1
TRIAL_FILE = "trial.json"


class Trial(msgspec.Struct, frozen=True):
    """A trial."""

    method: str  # name of the method
    pattern: int  # number of the traffic pattern, from 1; 1 is the case's own field
    repetition: int  # number of the repetition, from 0
    seed: int  # of all its random numbers
    role: str  # drives behind the errors: held_out, or fit in a case without held-out drives
    # errors of Eqs. 24-36 as fractions, in SUMO, all runs pooled; None where there is none.
    errors: dict[str, float | None]
    floor: dict[str, float | None]  # the same for drives of the simulation itself; what chance alone shows
    vehicle_level: float  # Eq. 23.
    surrogate_runs: int  # runs of the search in the surrogate
    sumo_runs: int  # runs in SUMO that the calibration needed; those for the errors are not counted
    calibration_s: float  # from the first case of Stage 1 to the values returned, as the paper times it
    parameters: dict[str, float]  # calibrated values by name
    critical: list[str]  # parameters found critical, most critical first; empty for a method that does not screen
    num_drivers: int  # driver parameters that there were to choose from
    # whether Stage 2 made the traffic flow worse beyond noise; None without stages
    stage2_undid_stage1: bool | None = None
    flow_accuracy: list[float] = []  # of Stage 1, of SAGA and of the end, on the same runs; empty without stages
    format: int = FORMAT


def read_trial(file: Path) -> Trial:
    """Return a trial that was kept.

    Raises:
        CaseError: the file cannot be read or is of another format.
    """
    try:
        trial = msgspec.json.decode(file.read_bytes(), type=Trial)
    except (OSError, msgspec.DecodeError, msgspec.ValidationError):
        raise CaseError(file, "", "expected a trial of this study; remove the file to make it again.") from None
    if trial.format != FORMAT:
        raise CaseError(file, "format", f"expected {FORMAT}; remove the file to make the trial again.")
    return trial


def trial_json(trial: Trial) -> str:
    """Return a trial as text."""
    return msgspec.json.format(msgspec.json.encode(trial), indent=1).decode() + "\n"


def table_of(trials: list[Trial]) -> pd.DataFrame:
    """Return trials as a table, a row for each; errors have the prefix error_."""
    rows: list[dict[str, Any]] = []
    for trial in trials:
        row: dict[str, Any] = {
            name: getattr(trial, name) for name in ("method", "pattern", "repetition", "seed", "role")
        }
        row |= {f"error_{name}": _number(trial.errors.get(name)) for name in MOES}
        row |= {f"floor_{name}": _number(trial.floor.get(name)) for name in MOES}
        row |= {
            name: getattr(trial, name) for name in ("vehicle_level", "surrogate_runs", "sumo_runs", "calibration_s")
        }
        row |= {"critical": " ".join(trial.critical), "num_drivers": trial.num_drivers}
        row["stage2_undid_stage1"] = "" if trial.stage2_undid_stage1 is None else str(trial.stage2_undid_stage1).lower()
        rows.append(row)
    order = ["pattern", "repetition", "method"]
    return pd.DataFrame(rows).sort_values(order, kind="stable", ignore_index=True) if rows else pd.DataFrame()


def _number(value: float | None) -> float:
    return np.nan if value is None else value
