"""One drive in the field: SUMO runs by itself, and what is around the subject vehicle is written down, read-only."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from experiments.blind_effects.field_spec import FieldSpec
from experiments.blind_effects.traffic_files import additional_file, field_demand, write_files
from experiments.roads.road import Road

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")
RADIUS_M = 330.0
SEEN_M = 150.0


@dataclass(frozen=True)
class Recording:
    """What happened around the subject vehicle, exactly."""

    # time_s, position_m (along the route), x_m, y_m, lane, edge, from_left, lateral_m, speed_mps,
    # acceleration_mps2, lateral_mps
    ego: pd.DataFrame
    others: pd.DataFrame  # the same but x_m and y_m, and `vehicle`; those on the route's lanes only
    stood_s: float | None  # when a standing vehicle came to stand, if one did


def record_drive(spec: FieldSpec, road: Road, seed: int, depart_s: float) -> Recording:
    """Run SUMO once.

    Raises:
        RuntimeError: the subject vehicle did not come to the end of the road or SUMO failed.
    """
    import libsumo
    from libsumo import constants as tc

    wanted = (
        tc.VAR_LANE_ID, tc.VAR_LANEPOSITION, tc.VAR_LANEPOSITION_LAT, tc.VAR_SPEED, tc.VAR_ACCELERATION,
        tc.VAR_SPEED_LAT, tc.VAR_POSITION,
    )  # fmt: skip
    ego: list[tuple] = []
    others: list[tuple] = []
    stood: list[float] = []
    places = road.places
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        demand = field_demand(spec, road, seed, depart_s)
        write_files(folder, [("demand.rou.xml", demand), ("signs.add.xml", additional_file(spec))])
        command = [
            "sumo", "-n", str(road.net_file), "-r", str(folder / "demand.rou.xml"),
            "-a", str(folder / "signs.add.xml"), "--step-length", "0.1", "--seed", str(seed), "--no-step-log",
            "--no-warnings", "--time-to-teleport", "-1", "--collision.action", "warn", *spec.options,
        ]  # fmt: skip
        libsumo.start(command)
        try:
            is_seen = False
            while libsumo.simulation.getTime() < road.duration_s + 600.0:
                libsumo.simulationStep()
                time_s = round(libsumo.simulation.getTime() - 0.1, 1)
                if (
                    spec.standing
                    and not stood
                    and any(
                        name in libsumo.vehicle.getIDList() and libsumo.vehicle.getStopState(name) & 1
                        for name in (f"standing.{number}" for number in range(len(spec.standing)))
                    )
                ):
                    stood.append(time_s)
                if not is_seen and "ego" in libsumo.simulation.getDepartedIDList():
                    libsumo.vehicle.subscribeContext("ego", tc.CMD_GET_VEHICLE_VARIABLE, RADIUS_M, wanted)
                    is_seen = True
                    continue
                if is_seen and "ego" in libsumo.simulation.getArrivedIDList():
                    break
                around = libsumo.vehicle.getContextSubscriptionResults("ego") if is_seen else {}
                for name, values in around.items():
                    place = places.get(values[tc.VAR_LANE_ID])
                    if place is None:
                        continue
                    row = (
                        time_s, place.begin_m + values[tc.VAR_LANEPOSITION], place.number, place.edge, place.from_left,
                        values[tc.VAR_LANEPOSITION_LAT], values[tc.VAR_SPEED], values[tc.VAR_ACCELERATION],
                        values[tc.VAR_SPEED_LAT],
                    )  # fmt: skip
                    if name == "ego":
                        ego.append((*row, *values[tc.VAR_POSITION]))
                    else:
                        others.append((*row, name))
            else:
                raise RuntimeError(f"The subject vehicle did not arrive within {road.duration_s + 600.0:g} s.")
        finally:
            libsumo.close()
    columns = ["time_s", "position_m", "lane", "edge", "from_left", "lateral_m", "speed_mps", "acceleration_mps2"]
    columns += ["lateral_mps"]
    return Recording(
        pd.DataFrame(ego, columns=[*columns, "x_m", "y_m"]),
        pd.DataFrame(others, columns=[*columns, "vehicle"]),
        stood[0] if stood else None,
    )


def subject_table(recording: Recording, road: Road) -> pd.DataFrame:
    """Return the subject vehicle's log in the columns of a case."""
    ego = recording.ego
    longitude_deg, latitude_deg = road.net.convertXY2LonLat(ego.x_m.to_numpy(copy=True), ego.y_m.to_numpy(copy=True))
    at_m, heading_rad = road.bends
    ahead = np.interp(ego.position_m + 5.0, at_m, heading_rad) - np.interp(ego.position_m - 5.0, at_m, heading_rad)
    slip_rad = np.arctan2(ego.lateral_mps, np.maximum(ego.speed_mps, 1.0))
    turn_radps = np.gradient(slip_rad, ego.time_s) if len(ego) > 1 else np.zeros(len(ego))
    half_m = 0.5 * road.lane_width_m
    offset_m = np.where(ego.lateral_m > 0.0, ego.lateral_m - half_m, ego.lateral_m + half_m)
    offset_m = np.where(ego.lateral_m == 0.0, -half_m, offset_m)
    limit_mps = ego.edge.map(road.limit_mps)
    return pd.DataFrame(
        {
            "time_s": ego.time_s,
            "road": ego.edge,
            "speed_limit_kmh": (3.6 * limit_mps).round(1),
            "speed_kmh": (3.6 * ego.speed_mps).round(2),
            "yaw_rate_radps": (ego.speed_mps * ahead / 10.0 + turn_radps).round(5),
            "longitude_rad": np.radians(longitude_deg).round(10),
            "latitude_rad": np.radians(latitude_deg).round(10),
            "acceleration_mps2": ego.acceleration_mps2.round(3),
            "lane": ego.lane.astype(int),
            "lane_offset_m": np.round(offset_m, 2),
        }
    )


def objects_table(recording: Recording, road: Road, reach_m: float = SEEN_M) -> pd.DataFrame:
    """Return the log of the objects within reach in the columns of a case."""
    ego = recording.ego.set_index("time_s")
    others = recording.others
    mine = ego.reindex(others.time_s)
    across_m = -others.from_left * road.lane_width_m + others.lateral_m
    own_m = (-mine.from_left * road.lane_width_m + mine.lateral_m).to_numpy()
    table = pd.DataFrame(
        {
            "time_s": others.time_s,
            "vehicle_id": others.vehicle,
            "lane": others.lane.astype(int),
            "relative_x_m": (others.position_m - mine.position_m.to_numpy()).round(2),
            "relative_y_m": (across_m - own_m).round(2),
            "speed_kmh": (3.6 * others.speed_mps).round(2),
            "heading_deg": np.degrees(np.arctan2(others.lateral_mps, np.maximum(others.speed_mps, 1.0))).round(1),
        }
    )
    return (
        table.loc[table.relative_x_m.abs() <= reach_m].sort_values(by=["time_s", "relative_x_m"]).reset_index(drop=True)
    )
