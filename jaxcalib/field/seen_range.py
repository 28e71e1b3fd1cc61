"""How far the sensors saw in fact: logs that end well before the stated range say so themselves.

What is counted within a range that was never seen is too little: a sensor that reaches 55 m instead of 150 m takes two
thirds off densities and volumes, and no behaviour fits.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxcalib.case.case import Perception
from jaxcalib.field.field_log import DriveLog

FEWEST_ROWS = 2000  # of objects ahead, or behind: fewer may all be near by chance
# A sensor whose distances are wrong by a tenth seems to end a tenth earlier, but sees as far as it should.
LARGEST_SHARE = 0.85
ONE_SIDED = 0.02  # of the rows on the other side: with fewer the sensors do not look there
LEAST_REACH_M = 1.0


def seen_perception(drives: Sequence[DriveLog], stated: Perception) -> Perception:
    """Return the sensors with the range in which objects were reported, where that is well below the stated one.

    Args:
        drives: the drives to fit; the farthest object of any of them counts.
        stated: the sensors as the case states them.
    """
    offset_m = np.concatenate([drive.objects.offset_m for drive in drives] or [np.zeros(0)])
    ahead_m, behind_m = offset_m[offset_m > 0.0], -offset_m[offset_m < 0.0]
    return dataclasses.replace(
        stated,
        ahead_m=_reach_m(ahead_m, stated.ahead_m, len(behind_m)),
        behind_m=_reach_m(behind_m, stated.behind_m, len(ahead_m)),
    )


def _reach_m(distance_m: np.ndarray, stated_m: float, num_opposite: int) -> float:
    looks_away = num_opposite >= FEWEST_ROWS and len(distance_m) < ONE_SIDED * num_opposite
    if len(distance_m) < FEWEST_ROWS and not looks_away:
        return stated_m
    farthest_m = max(float(np.ceil(distance_m.max(initial=0.0))), LEAST_REACH_M)
    return farthest_m if farthest_m < LARGEST_SHARE * stated_m else stated_m


def range_warnings(stated: Perception, seen: Perception) -> tuple[str, ...]:
    """Return one line for each direction in which less was seen than stated."""
    return tuple(
        f"case.toml: {name} is {before:g}, but no object was reported beyond {after:g} m; taken as {after:g} m."
        for name, before, after in (
            ("perception.ahead_m", stated.ahead_m, seen.ahead_m),
            ("perception.behind_m", stated.behind_m, seen.behind_m),
        )
        if after < before
    )
