"""One question of a validation, its answer, and the standard that asks it."""

import math

import msgspec

from jaxcalib.calibration.result.result import rounded

FORMAT = 1
OWN = "jaxcalib"
FHWA_2004 = "FHWA Toolbox III, 2004"
FHWA_2019 = "FHWA Toolbox III, 2019"


class Criterion(msgspec.Struct, frozen=True):
    """A criterion."""

    name: str  # what is asked
    standard: str  # who asks it
    value: float | None  # what was found; None where it cannot be
    limit: float | None  # what it must not exceed, or must reach
    is_upper: bool  # whether the limit is the greatest value allowed; else it is the least
    passes: bool | None  # the answer; None where it cannot be answered
    note: str = ""  # what the numbers mean, or why there is no answer


def at_most(name: str, standard: str, value: float, limit: float, note: str = "") -> Criterion:
    """Return a criterion that a value passes if it is not above a limit; there is no answer where one is not finite."""
    is_known = math.isfinite(value) and math.isfinite(limit)
    return Criterion(
        name, standard, rounded(value), rounded(limit), True, bool(value <= limit) if is_known else None, note
    )


def at_least(name: str, standard: str, value: float, limit: float, note: str = "") -> Criterion:
    """Return a criterion that a value passes if it is not below a limit; there is no answer where one is not finite."""
    is_known = math.isfinite(value) and math.isfinite(limit)
    return Criterion(
        name, standard, rounded(value), rounded(limit), False, bool(value >= limit) if is_known else None, note
    )


def not_testable(name: str, standard: str, reason: str) -> Criterion:
    """Return a criterion that cannot be answered."""
    return Criterion(name, standard, None, None, True, None, reason)
