"""What imperfect sensors make of a log: applied after the run, row by row."""

import numpy as np
import pandas as pd

from experiments.blind_effects.drive import SEEN_M, Recording, objects_table, subject_table
from experiments.blind_effects.field_spec import SensorFault
from experiments.roads.road import Road

EARTH_RADIUS_M = 6_371_000.0
FRAME_S = 0.1


def logs(recording: Recording, road: Road, fault: SensorFault, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the tables of the subject vehicle and of the objects as the vehicle recorded them."""
    rng = np.random.default_rng([seed, 23])
    subject = subject_table(recording, road)
    objects = objects_table(recording, road, SEEN_M + 60.0)
    if fault.latency_s:
        objects = _late(objects, subject, fault.latency_s)
    if fault.clock_drift:
        begin_s = subject.time_s.iloc[0]
        drifted = begin_s + (objects.time_s - begin_s) * (1.0 + fault.clock_drift)
        objects = objects.assign(time_s=drifted.round(1))
        is_kept = (objects.time_s <= subject.time_s.iloc[-1]) & ~objects.duplicated(["time_s", "vehicle_id"])
        objects = objects.loc[is_kept]
    if fault.bias:
        objects = objects.assign(relative_x_m=(objects.relative_x_m * (1.0 + fault.bias)).round(2))
    if fault.noise:
        error = fault.noise * rng.standard_normal((2, len(objects)))
        objects = objects.assign(
            relative_x_m=(objects.relative_x_m + error[0]).round(2),
            speed_kmh=np.maximum(objects.speed_kmh + 3.6 * error[1], 0.0).round(2),
        )
    reach_m = SEEN_M * (1.0 - fault.range_loss)
    objects = objects.loc[objects.relative_x_m.abs() <= reach_m]
    if fault.range_loss:
        objects = objects.loc[rng.uniform(size=len(objects)) >= 0.1 * fault.range_loss]
    objects = _numbered(objects.reset_index(drop=True))
    if fault.swaps_per_min:
        objects = _swapped(objects, fault.swaps_per_min, rng)
    if fault.map_offset_m:
        east_rad = fault.map_offset_m / (EARTH_RADIUS_M * np.cos(subject.latitude_rad))
        subject = subject.assign(longitude_rad=(subject.longitude_rad + east_rad).round(10))
    return subject, objects


def _late(objects: pd.DataFrame, subject: pd.DataFrame, latency_s: float) -> pd.DataFrame:
    """Report each relative state later by whole frames: the sensor sees from where it was then."""
    late_s = round(latency_s / FRAME_S) * FRAME_S
    late = objects.assign(time_s=(objects.time_s + late_s).round(1))
    return late.loc[late.time_s <= subject.time_s.iloc[-1]]


def _numbered(objects: pd.DataFrame) -> pd.DataFrame:
    """Replace SUMO's ids by numbers in order of first sight."""
    codes, _ = pd.factorize(objects.vehicle_id)
    return objects.assign(vehicle_id=codes + 1)


def _swapped(objects: pd.DataFrame, per_min: float, rng: np.random.Generator) -> pd.DataFrame:
    """Exchange the ids of two vehicles that are seen together, from then on."""
    ids = objects.vehicle_id.to_numpy().copy()
    times = objects.time_s.to_numpy()
    length_s = times[-1] - times[0]
    for at_s in np.sort(rng.uniform(times[0], times[-1], rng.poisson(per_min * length_s / 60.0))):
        frame = np.flatnonzero(times == times[np.searchsorted(times, at_s)])
        if len(frame) < 2:
            continue
        row = int(rng.integers(len(frame) - 1))
        first, second = ids[frame[row]], ids[frame[row + 1]]
        later = times >= at_s
        is_first, is_second = later & (ids == first), later & (ids == second)
        ids[is_first], ids[is_second] = second, first
    return objects.assign(vehicle_id=ids)
