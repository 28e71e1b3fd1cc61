"""What each part of the method buys: the method as improved beside itself without one part at a time."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from experiments.paper.comparison import mean_error, paired, rounded
from experiments.paper.methods import ABLATIONS, IMPROVED, label_of
from experiments.paper.trial import Trial
from jaxcalib.calibration.objective.accuracy import VEHICLE_LEVEL_SUM


def is_ablation(trials: Sequence[Trial]) -> bool:
    """Say whether trials leave out parts of the method."""
    return any(trial.method in ABLATIONS for trial in trials)


def ablation_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return a row for each variant: its errors, the method's as improved on the same patterns, and what it cost.

    Variants are compared on the patterns and repetitions that both have made; what they add to an error stands as its
    change. The mean of errors is that of the nine of Eqs. 24-36.
    """
    rows = []
    for variant in (IMPROVED, *ABLATIONS):
        pairs = paired(trials, variant, IMPROVED)
        if not pairs:
            continue
        ours, improved = ([pair[side] for pair in pairs] for side in (0, 1))
        row: dict[str, object] = {"variant": label_of(variant), "trials": len(pairs)}
        for name, value_of in ((VEHICLE_LEVEL_SUM, lambda trial: trial.vehicle_level), ("mean_of_errors", mean_error)):
            mean, whole = (float(np.mean([value_of(trial) for trial in side])) for side in (ours, improved))
            row |= {name: rounded(mean), f"{name}_change": rounded(mean - whole)}
        for name in ("surrogate_runs", "sumo_runs", "calibration_s"):
            row[name] = rounded(float(np.mean([getattr(trial, name) for trial in ours])))
        rows.append(row)
    return pd.DataFrame(rows)
