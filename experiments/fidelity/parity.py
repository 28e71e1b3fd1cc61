"""Car-following in both simulators behind recorded leaders, step by step."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.fidelity.platoon import STEP_S, Platoon, largest_difference

DATA_SETS = ("openacc_astazero", "openacc_zalazone", "ngsim_i80_human_pairs")
NUM_STEPS = 600
NGSIM_STEPS = 450  # few of its pairs last for a minute
NUM_FOLLOWERS = 5
MOST_DIFFERENCE_M = 0.05
# SUMO's W99 draws a random number behind a leader who accelerates harder than this; no draw can be compared
MOST_ACCELERATION_MPS2 = 0.99

SUMO_MODELS: dict[str, dict[str, float]] = {
    "IDM": {"tau": 1.13, "minGap": 2.2, "accel": 1.6, "decel": 2.3, "delta": 3.7, "emergencyDecel": 9.0},
    "Krauss": {"tau": 1.13, "minGap": 2.2, "accel": 1.6, "decel": 2.9, "sigma": 0.0, "emergencyDecel": 9.0},
    "W99": {
        "minGap": 1.7, "cc1": 1.1, "cc2": 6.0, "cc3": -10.0, "cc4": -0.3, "cc5": 0.35, "cc6": 8.0, "cc7": 0.25,
        "cc8": 0.95, "cc9": 1.5, "decel": 4.5, "emergencyDecel": 9.0,
    },
}  # fmt: skip


def recorded_platoons(data: Path, model: str, per_set: int) -> Iterator[tuple[str, Platoon]]:
    """Yield platoons behind recorded leaders, of each data set the first that may serve, with their names."""
    for name in DATA_SETS:
        table = pd.read_csv(data / "car_following" / f"{name}.csv.gz", usecols=["pair_id", "time_s", "v_lead_mps"])
        steps = NGSIM_STEPS if name.startswith("ngsim") else NUM_STEPS
        num_found = 0
        for pair, rows in table.groupby("pair_id", sort=True):
            for leader in _windows(rows["v_lead_mps"].to_numpy(float), steps):
                if model == "W99" and np.abs(np.diff(leader)).max() > MOST_ACCELERATION_MPS2 * STEP_S:
                    continue
                yield f"{name} {pair}", _behind(leader)
                num_found += 1
                break  # one of each pair
            if num_found == per_set:
                break


def parity_table(data: Path, per_set: int) -> list[dict[str, Any]]:
    """Return the largest difference in position for each model and recorded leader."""
    rows = []
    for model, attributes in SUMO_MODELS.items():
        for name, platoon in recorded_platoons(data, model, per_set):
            difference = largest_difference(platoon, model, attributes)
            rows.append(
                {
                    "model": model,
                    "leader": name,
                    "duration_s": STEP_S * len(platoon.leader_mps),
                    "double_precision_m": difference.double_m,
                    "single_precision_m": difference.single_m,
                }
            )
    return rows


def _windows(speed_mps: np.ndarray, steps: int) -> Iterator[np.ndarray]:
    """Yield parts of a record in which the leader drives, smoothed over a second."""
    kernel = np.full(11, 1.0 / 11.0)
    for begin in range(0, len(speed_mps) - steps - 10, steps):
        part = np.convolve(speed_mps[begin : begin + steps + 10], kernel, "valid")
        if part.mean() > 3.0 and np.isfinite(part).all():
            yield np.maximum(part, 0.0)


def _behind(leader_mps: np.ndarray) -> Platoon:
    """Return followers at the leader's speed whose gaps and desired speeds differ."""
    rank = np.arange(NUM_FOLLOWERS)
    speed = np.full(NUM_FOLLOWERS, leader_mps[0])
    return Platoon(leader_mps, 4.0 + (1.1 + 0.3 * rank) * speed, speed, leader_mps.max() + 4.0 + 2.0 * rank)
