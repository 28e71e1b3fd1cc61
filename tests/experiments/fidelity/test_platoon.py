"""Car-following models against SUMO, step by step, behind leaders that stop and go."""

import numpy as np
import pytest

from experiments.fidelity.parity import MOST_DIFFERENCE_M, SUMO_MODELS, recorded_platoons
from experiments.fidelity.platoon import STEP_S, Platoon, largest_difference
from tests.places import SHARED_DATA

TIME_S = STEP_S * np.arange(600)
STOPS_TWICE = np.maximum(0.0, 7.0 - 8.0 * np.cos(TIME_S / 10.0))  # with less than 1 m/s^2, beyond which W99 draws
BRAKES_HARD = np.clip(16.0 + 5.0 * np.sin(TIME_S / 4.0) - 18.0 * (np.abs(TIME_S - 33.0) < 6.0), 0.0, None)
BRAKES_HARD = np.convolve(np.pad(BRAKES_HARD, (20, 20), "edge"), np.full(41, 1 / 41), "valid")
STANDS = np.zeros(600)


def platoon(leader_mps: np.ndarray) -> Platoon:
    gaps = np.asarray([27.0, 18.5, 31.0, 40.0]) + 2.0 * leader_mps[0]
    speeds = np.asarray([2.4, 4.1, 5.3, 3.2]) if leader_mps[0] < 8.0 else np.asarray([14.1, 12.6, 15.2, 13.3])
    return Platoon(leader_mps, gaps, speeds, np.asarray([30.1, 27.4, 33.2, 24.3]))


@pytest.mark.parametrize(
    ("model", "leader"),
    [
        ("IDM", STOPS_TWICE), ("IDM", BRAKES_HARD), ("IDM", STANDS), ("Krauss", STOPS_TWICE), ("Krauss", BRAKES_HARD),
        ("Krauss", STANDS), ("W99", STOPS_TWICE), ("W99", STANDS),
    ],
)  # fmt: skip
def test_followers_are_where_sumo_s_are(model: str, leader: np.ndarray) -> None:
    found = largest_difference(platoon(leader), model, SUMO_MODELS[model])
    assert found.double_m < 1e-3
    assert found.single_m < 1e-3


@pytest.mark.long
@pytest.mark.parametrize("model", SUMO_MODELS)
def test_behind_recorded_leaders_as_well(model: str) -> None:
    if not (SHARED_DATA / "car_following").is_dir():
        pytest.skip(f"the recordings are not at hand: {SHARED_DATA / 'car_following'}")
    found = [largest_difference(one, model, SUMO_MODELS[model]) for _, one in recorded_platoons(SHARED_DATA, model, 1)]
    assert len(found) == 3
    assert max(one.double_m for one in found) < MOST_DIFFERENCE_M
