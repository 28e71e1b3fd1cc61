"""Recordings that nobody here made: a production car's radar and trajectories seen from the air, each spoilt too."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxcalib.field.physics.motion import DriveMotion
from tests.jaxcalib.field.physics.motions import judged, with_relative_speeds
from tests.places import SHARED_DATA

EARTH_RADIUS_M = 6_371_000.0
LEAST_PROBE_S, RANGE_M = 13.0, 150.0
EVERY, MOST = 6, 6  # vehicle of a segment is taken for a probe, and how many of one segment

RADAR = SHARED_DATA / "perception/comma2k19_radar.csv.gz"
FREEWAY = SHARED_DATA / "freeway/us101_segments.csv.gz"


def motion_of(
    name: str, subject: pd.DataFrame, objects: pd.DataFrame, position_m: np.ndarray, heading_rad: np.ndarray
) -> DriveMotion:
    """A drive of tables whose columns have our names."""
    unknown = np.full(len(subject), np.nan)
    return DriveMotion(
        id=name,
        role="fit",
        subject_file=Path("subject.csv"),
        objects_file=Path("objects.csv"),
        time_s=subject.time_s.to_numpy(),
        position_m=position_m,
        speed_mps=subject.speed_mps.to_numpy(),
        acceleration_mps2=subject.accel_mps2.to_numpy(),
        yaw_rate_radps=subject.yaw_rate_radps.to_numpy() if "yaw_rate_radps" in subject else unknown,
        heading_rad=heading_rad,
        lateral_m=unknown,
        across_m=subject.y_m.to_numpy() if "y_m" in subject else np.zeros(len(subject)),
        object_time_s=objects.time_s.to_numpy(),
        vehicle=np.unique(objects.vehicle_id, return_inverse=True)[1],
        relative_x_m=objects.relative_x_m.to_numpy(),
        relative_y_m=objects.relative_y_m.to_numpy(),
        object_speed_mps=objects.object_speed_mps.to_numpy(),
    )


@pytest.fixture(scope="module")
def radar() -> list[DriveMotion]:
    """A minute of comma2k19; places are the way between fixes of GNSS, smoothed over a second."""
    if not RADAR.is_file():
        pytest.skip("needs shared/data: perception/comma2k19_*.csv.gz")
    subject = pd.read_csv(RADAR.with_name("comma2k19_ego.csv.gz"))
    latitude, longitude = np.radians(subject.lat), np.radians(subject.lon)
    plane_m = pd.DataFrame({"x": EARTH_RADIUS_M * longitude * np.cos(latitude.mean()), "y": EARTH_RADIUS_M * latitude})
    x_m, y_m = plane_m.rolling(11, 1, center=True).mean().to_numpy().T
    step_m = np.hypot(np.diff(x_m), np.diff(y_m))
    heading_rad = np.unwrap(np.arctan2(np.gradient(y_m), np.gradient(x_m)))
    names = {"track_id": "vehicle_id", "x_rel_m": "relative_x_m", "y_rel_left_m": "relative_y_m"}
    objects = pd.read_csv(RADAR).rename(columns=names | {"v_abs_mps": "object_speed_mps"})
    return [motion_of("comma2k19", subject, objects, np.concatenate([[0.0], np.cumsum(step_m)]), heading_rad)]


@pytest.fixture(scope="module")
def probes() -> list[DriveMotion]:
    """Vehicles of NGSIM's US-101 as subject vehicles, with all others within range; raw speeds."""
    if not FREEWAY.is_file():
        pytest.skip("needs shared/data: freeway/us101_segments.csv.gz")
    motions = []
    for segment, rows in pd.read_csv(FREEWAY).groupby("segment_id"):
        lasts_s = rows.groupby("vehicle_id").time_s.agg(np.ptp)
        for vehicle in lasts_s.index[lasts_s > LEAST_PROBE_S][::EVERY][:MOST]:
            own = rows[rows.vehicle_id == vehicle].sort_values("time_s")
            others = rows[rows.vehicle_id != vehicle].merge(own[["time_s", "x_m", "y_m"]], "inner", "time_s")
            others = others.assign(
                relative_x_m=others.x_m_x - others.x_m_y,
                relative_y_m=others.y_m_x - others.y_m_y,
                object_speed_mps=others.speed_mps,
            )
            near = others[others.relative_x_m.abs() < RANGE_M]
            motions.append(motion_of(f"{segment}-{vehicle}", own, near, own.x_m.to_numpy(), np.zeros(len(own))))
    assert len(motions) > 10
    return motions


FAULTS: dict[str, Callable[[DriveMotion], DriveMotion]] = {
    "object_speed_unit": lambda motion: replace(motion, object_speed_mps=motion.object_speed_mps / 3.6),
    "speed_scale": lambda motion: replace(motion, speed_mps=motion.speed_mps / 3.6),
    "relative_speeds": with_relative_speeds,
    "distance_unit": lambda motion: replace(motion, relative_x_m=motion.relative_x_m / 0.3048),
    "clock_offset": lambda motion: replace(motion, object_time_s=motion.object_time_s + 3.0),
}


@pytest.mark.parametrize("recording", ["radar", "probes"])
def test_real_recordings_are_believed(recording: str, request: pytest.FixtureRequest):
    assert not [one for one in judged(request.getfixturevalue(recording)) if one.is_refused]


@pytest.mark.parametrize("recording", ["radar", "probes"])
@pytest.mark.parametrize("kind", FAULTS)
def test_faults_of_real_recordings_are_refused_for_what_they_are(
    kind: str, recording: str, request: pytest.FixtureRequest
):
    spoilt = [FAULTS[kind](motion) for motion in request.getfixturevalue(recording)]
    refused = [one.kind for one in judged(spoilt) if one.is_refused]
    assert refused == [kind]
