"""Drives made of two lines of motion, and null models made of numbers."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.diagnosis.features.conventions import Conventions
from jaxcalib.diagnosis.features.features import Cell, Channel
from jaxcalib.diagnosis.features.noise import NullModel
from surrogate.road.drive_table import DriveTable, LogFormat

STEP_S = 0.1
ROAD = Conventions(
    step_s=STEP_S,
    nominal_length_m=4.8,
    stretch_m=np.linspace(0.0, 2000.0, 11),
    period_s=np.arange(0.0, 180.0, 60.0),
    lane_from_left=np.asarray([2, 1]),
    segment_end_m=np.asarray([np.inf]),
    limit_mps=np.full((2, 1), 25.0),
    merge_m=np.zeros((0, 2)),
    log=LogFormat(ahead_m=150.0, behind_m=120.0, place_step_m=0.01, speed_step_mps=0.01 / 3.6),
)


def two_vehicles(num_instants: int = 600) -> DriveTable:
    """Return a subject vehicle and one ahead of it in the other lane; both change speed, each in its own rhythm."""
    time_s = STEP_S * np.arange(num_instants)
    subject_speed = 15.0 + 3.0 * np.sin(0.31 * time_s)
    other_speed = 15.5 + 2.0 * np.sin(0.47 * time_s + 1.0)
    subject_m = 100.0 + np.concatenate([[0.0], np.cumsum(STEP_S * 0.5 * (subject_speed[1:] + subject_speed[:-1]))])
    other_m = 140.0 + np.concatenate([[0.0], np.cumsum(STEP_S * 0.5 * (other_speed[1:] + other_speed[:-1]))])
    instant = np.repeat(np.arange(num_instants), 2)
    position_m = np.stack([subject_m, other_m], axis=1).ravel()
    return DriveTable(
        interval_s=STEP_S,
        time_s=time_s,
        is_valid=np.ones(num_instants, bool),
        subject_acceleration_mps2=np.gradient(subject_speed, STEP_S),
        subject_speed_mps=subject_speed,
        instant=instant,
        track=np.tile([-1, 0], num_instants),
        lane=np.tile([0, 1], num_instants),
        offset_m=position_m - np.repeat(subject_m, 2),
        position_m=position_m,
        speed_mps=np.stack([subject_speed, other_speed], axis=1).ravel(),
        lateral_m=np.zeros(2 * num_instants),
    )


def made_up_null(num_features: int = 40, num_parameters: int = 3, seed: int = 4) -> NullModel:
    """Return a null model with correlated noise and slopes at random."""
    random = np.random.default_rng(seed)
    mixing = np.eye(num_features) + 0.15 * random.standard_normal((num_features, num_features))
    noise = mixing @ mixing.T
    deviation = np.sqrt(np.diag(noise))
    noise = noise / np.outer(deviation, deviation)
    slope = random.standard_normal((num_features, num_parameters))
    prior = np.full(num_parameters, 1.5)
    cells = tuple(Cell(Channel.CLOSED_LOOP, f"measure_{k % 8}", f"regime {k}") for k in range(num_features))
    covariance = noise + (slope * prior**2) @ slope.T
    mean, deviation = np.linspace(-1.0, 2.0, num_features), np.linspace(0.5, 2.0, num_features)
    return NullModel(cells, mean, deviation, covariance, noise, slope, prior)


def one_feature_each(names: Sequence[str]) -> NullModel:
    """Return a null model in which each feature is one parameter, in steps, nearly without noise and open by far."""
    size = len(names)
    return NullModel(
        cells=tuple(Cell(Channel.CLOSED_LOOP, name) for name in names),
        mean=np.zeros(size),
        deviation=np.ones(size),
        covariance=1e-4 * np.eye(size) + 1e4 * np.eye(size),
        noise=1e-4 * np.eye(size),
        slope=np.eye(size),
        prior_steps=np.full(size, 100.0),
    )
