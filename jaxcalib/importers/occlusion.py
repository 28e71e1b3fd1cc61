"""Who is hidden behind others from a vehicle's point of view."""

import numpy as np

HALF_WIDTH_M = 0.9  # of what hides others; less than half a car, for one sees past a corner
USUAL_LENGTH_M = 4.5


def visible_from_origin(x_m: np.ndarray, y_m: np.ndarray, length_m: np.ndarray) -> np.ndarray:
    """Which vehicles are seen from the origin, each by the middle of the end that is turned there.

    A nearer vehicle hides the directions between the corners of its outline.

    Args:
        x_m: places of front bumpers' middles, along the road.
        y_m: the same, across.
        length_m: nan where unknown.
    """
    length_m = np.where(np.isnan(length_m), USUAL_LENGTH_M, length_m)
    corner_x = np.stack([x_m, x_m, x_m - length_m, x_m - length_m], axis=-1)
    corner_y = np.stack([y_m - HALF_WIDTH_M, y_m + HALF_WIDTH_M] * 2, axis=-1)
    nearest_x = np.where((x_m - length_m) > 0.0, x_m - length_m, np.minimum(x_m, 0.0))
    bearing = np.arctan2(y_m, nearest_x)
    distance_m = np.hypot(nearest_x, y_m)
    away = _turned(np.arctan2(corner_y, corner_x) - bearing[:, None])
    low, high = away.min(axis=-1), away.max(axis=-1)
    visible = np.ones(len(x_m), bool)
    for number in np.argsort(distance_m):
        nearer = distance_m < distance_m[number] - 1e-9
        turned = _turned(bearing[number] - bearing)
        visible[number] = not np.any(nearer & (turned > low) & (turned < high))
    return visible


def _turned(angle_rad: np.ndarray) -> np.ndarray:
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
