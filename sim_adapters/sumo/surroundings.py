"""The vehicles around SUMO's subject vehicle, laid into the surrogate's vehicle arrays."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from surrogate.road.traffic_state import EMPTY, HEAD, UNSEEN, VehicleArrays

PLACES = 224  # vehicles around one subject vehicle; if there are more, the farthest are left out


@dataclass(frozen=True)
class Surroundings:
    """Vehicles at one instant, one entry each, in any order; the subject vehicle is one of them."""

    row: np.ndarray  # row of the road
    position_m: np.ndarray  # front bumper on the route's axis
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray
    vehicle_class: np.ndarray  # index of its vType among the world's classes
    subject: int  # entry of the subject vehicle
    speed_factor: float  # desired speed of the subject vehicle over the limit


def vehicle_arrays(around: Surroundings, num_rows: int) -> tuple[VehicleArrays, np.ndarray, int]:
    """Return the vehicles as the surrogate keeps them, the heads of the rows, and the subject vehicle's entry.

    Leaves are NumPy arrays of one length, so that one compiled program serves every instant.
    """
    distance_m = np.abs(around.position_m - around.position_m[around.subject])
    kept = np.argsort(distance_m, kind="stable")[:PLACES]
    kept = kept[np.lexsort((-around.position_m[kept], around.row[kept]))]
    row = around.row[kept]
    head = np.searchsorted(row, np.arange(num_rows + 1)) + np.arange(num_rows + 1)
    head[-1] = len(kept) + num_rows
    entry = np.arange(len(kept)) + row + 1
    size = PLACES + num_rows

    # Returns Any: the record is annotated with JAX arrays, for which NumPy's stand in.
    def spread(values: np.ndarray | float, at_heads: float, empty: float, dtype: type = np.float32) -> Any:
        table = np.full(size, empty, dtype)
        table[head[:-1]] = at_heads
        table[entry] = values
        return table

    def same(value: float, dtype: type = np.float32) -> Any:
        return np.full(size, value, dtype)

    rows = spread(row, 0, num_rows, np.int32)
    rows[head[:-1]] = np.arange(num_rows)
    arrays = VehicleArrays(
        position_m=spread(around.position_m[kept], np.inf, -np.inf),
        speed_mps=spread(around.speed_mps[kept], 0.0, 0.0),
        acceleration_mps2=spread(around.acceleration_mps2[kept], 0.0, 0.0),
        row=rows,
        vehicle_class=spread(around.vehicle_class[kept], HEAD, EMPTY, np.int32),
        destination=same(0, np.int32),
        identity=same(0, np.int32),
        track=same(UNSEEN, np.int32),
        speed_factor=same(around.speed_factor),
        gain_left_memory=same(0.0),
        gain_right_memory=same(0.0),
        keep_right_memory=same(0.0),
        look_ahead_speed_mps=same(0.0),
        own_advice_mps2=same(np.inf),
        asked_advice_mps2=same(np.inf),
        speed_limit_mps=same(1.0),
        slow_position_m=same(np.inf),
        slow_limit_mps=same(1.0),
        stop_position_m=same(np.inf),
    )
    return arrays, head.astype(np.int32), int(entry[np.flatnonzero(kept == around.subject)[0]])
