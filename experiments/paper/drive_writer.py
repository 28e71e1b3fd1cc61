"""Drives simulated in SUMO, written as the logs that a subject vehicle would have recorded."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxcalib.field.map_matching import lane_centre_m
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunRequest
from sim_adapters.sumo.job import SumoRun
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator
from sim_adapters.units import SECONDS_PER_HOUR

KMH_PER_MPS = SECONDS_PER_HOUR / 1000.0


def write_drives(
    problem: CalibrationProblem,
    values: Sequence[float],
    first_seed: int,
    folder: Path,
    num_processes: int | None = None,
) -> None:
    """Simulate each drive of a case in SUMO and write its two tables under the names that the case has for them.

    The case's own logs are not looked at; the folder is a copy of its folder, whose tables are replaced. Each drive has
    a seed of its own, and SUMO one process for each core unless given.

    Raises:
        RuntimeError: a drive failed in SUMO.
    """
    perception, parts = problem.case.perception, problem.parts
    geometry = build_route_geometry(problem.scenario.row_map)
    drives = problem.case.drives
    with SumoSimulator(
        scenario=problem.scenario,
        layout=problem.layout,
        fold=problem.fold,
        sensor=SensorRange(perception.ahead_m, perception.behind_m),
        subject_vehicle=parts.subject.vehicle,
        frame_interval_s=parts.scenario.step_s,
        end_s=parts.scenario.duration_s,
        num_processes=num_processes,
    ) as sumo:
        requests = [RunRequest(tuple(values), first_seed + n, drive.depart_s) for n, drive in enumerate(drives)]
        waiting = [sumo.begin(request) for request in requests]
        for drive, begun in zip(drives, waiting, strict=True):
            run = begun.result()
            if isinstance(run, str):
                raise RuntimeError(f"drive {drive.id} failed in SUMO: {run}")
            if not len(run.time_s):
                raise RuntimeError(f"the subject vehicle of drive {drive.id} never entered; the entrance was full")
            subject, objects = log_tables(run, geometry, perception.ahead_m, perception.behind_m)
            for table, file in ((subject, drive.subject_file), (objects, drive.objects_file)):
                to = folder / file.relative_to(problem.case.folder)
                if to.suffix == ".parquet":
                    table.to_parquet(to, index=False)
                else:
                    table.to_csv(to, index=False)


def log_tables(
    run: SumoRun, geometry: RouteGeometry, ahead_m: float, behind_m: float
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the two tables of Table 1 of the paper for a run at the sampling of the logs."""
    is_subject = run.vehicle == -1
    edge = geometry.edge_at(run.position_m)
    lane = _lane_number(geometry, edge, run.row)
    across_m = lane_centre_m(geometry, edge, run.row) + run.lateral_m
    longitude, latitude = _place(geometry, run.row[is_subject], run.position_m[is_subject], run.lateral_m[is_subject])
    subject = pd.DataFrame(
        {
            "time_s": np.round(run.time_s[is_subject], 3),
            "road": np.asarray(geometry.edges)[edge[is_subject]],
            "speed_limit_kmh": np.nan,
            "speed_kmh": np.round(KMH_PER_MPS * run.speed_mps[is_subject], 4),
            "yaw_rate_radps": np.nan,
            "longitude_rad": np.round(longitude, 11),
            "latitude_rad": np.round(latitude, 11),
            "acceleration_mps2": np.round(run.acceleration_mps2[is_subject], 4),
            "lane": lane[is_subject],
            "lane_offset_m": np.nan,
        }
    )
    instant = np.searchsorted(run.time_s[is_subject], run.time_s[~is_subject])
    ahead = run.position_m[~is_subject] - run.position_m[is_subject][instant]
    objects = pd.DataFrame(
        {
            "time_s": np.round(run.time_s[~is_subject], 3),
            "vehicle_id": run.vehicle[~is_subject] + 1,
            "lane": lane[~is_subject],
            "relative_x_m": np.round(ahead, 3),
            "relative_y_m": np.round(across_m[~is_subject] - across_m[is_subject][instant], 3),
            "speed_kmh": np.round(KMH_PER_MPS * run.speed_mps[~is_subject], 4),
            "heading_deg": 0.0,
        }
    )
    return subject, objects.loc[(ahead <= ahead_m) & (ahead >= -behind_m), :]


def _lane_number(geometry: RouteGeometry, edge: np.ndarray, row: np.ndarray) -> "pd.arrays.IntegerArray":
    """Return lanes counted from the right, from 1; nothing where the edge has no lane in that row."""
    is_lane = geometry.row_of_lane[edge] == row[:, None]
    return pd.arrays.IntegerArray(np.argmax(is_lane, axis=1) + 1, ~is_lane.any(axis=1))


def _place(
    geometry: RouteGeometry, row: np.ndarray, position_m: np.ndarray, lateral_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return longitude and latitude in radians of places on the route."""
    segment = np.empty(len(row), int)
    for number in np.unique(row):
        of_row = geometry.by_row[number]
        here = row == number
        number_in_row = np.searchsorted(geometry.begin_m[of_row], position_m[here], side="right") - 1
        segment[here] = of_row[np.clip(number_in_row, 0, len(of_row) - 1)]
    share = (position_m - geometry.begin_m[segment]) / geometry.length_m[segment]
    step = geometry.step_xy[segment]
    left = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.hypot(step[:, 0], step[:, 1])[:, None]
    xy = geometry.begin_xy[segment] + share[:, None] * step + lateral_m[:, None] * left
    xy = xy - np.asarray(geometry.net_offset_m)
    longitude, latitude = geometry.projection(xy[:, 0], xy[:, 1], inverse=True)
    return np.radians(longitude), np.radians(latitude)
