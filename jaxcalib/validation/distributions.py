"""Whole distributions, not means alone: fine histograms of a drive and the distance of two of them."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from jaxcalib.problem.problem import LEAST_SPEED_MPS, LONGEST_HEADWAY_S
from surrogate.road.perception import PerceptionFrame

BORDERS: Mapping[str, Float[np.ndarray, " border"]] = {
    "subject_speed_mps": np.linspace(0.0, 60.0, 241),
    "background_speed_mps": np.linspace(0.0, 60.0, 241),
    "subject_time_headway_s": np.linspace(0.0, LONGEST_HEADWAY_S, 121),
    "background_time_headway_s": np.linspace(0.0, LONGEST_HEADWAY_S, 121),
    "background_approach_rate_mps": np.linspace(-15.0, 15.0, 241),
    "vehicles_seen": np.linspace(-0.5, 149.5, 151),
}
DESCRIPTIONS = {
    "subject_speed_mps": "speed of the subject vehicle",
    "background_speed_mps": "speed of the vehicles seen",
    "subject_time_headway_s": "time headway of the subject vehicle, while it follows",
    "background_time_headway_s": "time headway of the vehicles seen, while they follow",
    "background_approach_rate_mps": "own speed less the leader's, while following",
    "vehicles_seen": "vehicles within the sensors' range",
}
NUM_COUNTS = sum(len(borders) - 1 for borders in BORDERS.values())


def histograms(frames: PerceptionFrame) -> dict[str, Float[np.ndarray, " bin"]]:
    """Return the counts of a drive's frames; what lies beyond the borders counts in the outermost bins."""
    valid = np.asarray(frames.object_valid) & np.asarray(frames.valid)[:, None]
    is_subject = np.asarray(frames.object_is_subject) & valid
    is_background = valid & ~is_subject
    speed, row = np.asarray(frames.object_speed_mps, float), np.asarray(frames.object_row)
    offset_m = np.asarray(frames.object_offset_m, float)
    # objects are sorted by row and place, so a leader is the one before
    has_leader = np.zeros_like(valid)
    has_leader[:, 1:] = valid[:, 1:] & valid[:, :-1] & (row[:, 1:] == row[:, :-1])
    leader_m, leader_mps = (np.roll(values, 1, axis=1) for values in (offset_m, speed))
    headway_s = np.where(has_leader, leader_m - offset_m, np.inf) / np.maximum(speed, LEAST_SPEED_MPS)
    follows = has_leader & (speed > LEAST_SPEED_MPS) & (headway_s < LONGEST_HEADWAY_S)
    samples = {
        "subject_speed_mps": speed[is_subject],
        "background_speed_mps": speed[is_background],
        "subject_time_headway_s": headway_s[follows & is_subject],
        "background_time_headway_s": headway_s[follows & is_background],
        "background_approach_rate_mps": (speed - leader_mps)[follows & is_background],
        "vehicles_seen": is_background.sum(axis=1)[np.asarray(frames.valid)],
    }
    return {
        name: np.histogram(np.clip(samples[name], borders[0], borders[-1]), borders)[0].astype(float)
        for name, borders in BORDERS.items()
    }


def distances(name: str, one: Float[np.ndarray, " bin"], other: Float[np.ndarray, " bin"]) -> tuple[float, float]:
    """Return how far two distributions are apart: Kolmogorov-Smirnov, and Wasserstein-1 in the unit of the quantity.

    Both are nan where one of the two is empty.
    """
    if not one.sum() or not other.sum():
        return float("nan"), float("nan")
    gap = np.abs(np.cumsum(one) / one.sum() - np.cumsum(other) / other.sum())
    return float(gap.max()), float(np.sum(gap * np.diff(BORDERS[name])))
