"""Leader-follower pairs whose follower drives by a known model with known parameters."""

import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair
from surrogate.car_following.registry import car_following_model
from surrogate.car_following.replay import ReplayStart, replay

TRUTH = {
    "idm": {
        "jam_gap_m": 2.7, "time_gap_s": 1.45, "max_acceleration_mps2": 1.1, "max_deceleration_mps2": 1.7,
        "acceleration_exponent": 4.0,
    },
    "gipps": {
        "jam_gap_m": 3.1, "time_gap_s": 0.7, "max_acceleration_mps2": 1.3, "max_deceleration_mps2": 2.4,
        "leader_deceleration_mps2": 2.9,
    },
}  # fmt: skip


def stop_and_go(num_steps: int, phase: float) -> np.ndarray:
    time_s = STEP_S * np.arange(num_steps)
    return np.maximum(0.0, 9.0 + 8.0 * np.sin(time_s / 11.0 + phase) + 3.0 * np.sin(time_s / 3.7 + 2.0 * phase))


def simulated_pair(model: str, name: str, num_steps: int, phase: float, noise_m: float = 0.0) -> RecordedPair:
    leader = stop_and_go(num_steps, phase)
    start = ReplayStart(*(jnp.asarray([value]) for value in (leader[0], 0.0, 8.0 + 1.4 * leader[0], 0.0, 28.0)))
    entry = car_following_model(model)
    _, states = replay(entry.build(TRUTH[model]), start, jnp.asarray(leader)[:, None], jnp.full(1, 0.5), STEP_S)
    speed = np.append(leader[0], np.asarray(states.speed_mps[:-1, 0]))
    gap = np.append(8.0 + 1.4 * leader[0], np.asarray(states.gap_m[:-1, 0]))
    noise = noise_m * np.random.default_rng(int(10 * phase)).standard_normal(num_steps)
    return RecordedPair(name, leader, speed, np.maximum(gap + noise, 0.2))


def table(**changes: object) -> pd.DataFrame:
    pair = simulated_pair("idm", "p", 300, 0.2)
    columns = {
        "pair_id": "a", "time_s": STEP_S * np.arange(300), "v_lead_mps": pair.leader_mps,
        "v_foll_mps": pair.follower_mps, "gap_m": pair.gap_m,
    }  # fmt: skip
    return pd.DataFrame({**columns, **changes})
