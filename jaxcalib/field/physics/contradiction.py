"""What a contradiction is, and the units and habits that cause the usual ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

SIGNIFICANT = 4.0  # standard errors that a deviation must have
NEAR_FACTOR = 0.08  # relative: how near a factor must be to that of a unit to be named after it

# By how much speeds are too small that stand in a column in km/h but are of another unit.
SPEED_UNITS: Mapping[str, float] = {"m/s": 3.6, "mph": 1.609344, "knots": 1.852, "ft/s": 1.09728}
# The same of distances in a column in metres.
LENGTH_UNITS: Mapping[str, float] = {"feet": 0.3048}
# The same of angles per second in a column in rad/s, and of accelerations in one in m/s^2.
ANGLE_UNITS: Mapping[str, float] = {"degrees": 0.0174533}
ACCELERATION_UNITS: Mapping[str, float] = {"g": 9.80665, "ft/s2": 0.3048, "km/h per second": 1.0 / 3.6}


@dataclass(frozen=True)
class Contradiction:
    """Two quantities of the logs that cannot both be right."""

    kind: str  # what is wrong, in one or two words, for counts and tests
    file: Path  # a file that shows it
    column: str  # the column or columns concerned
    words: str  # what is wrong, by how much, and what to do; one sentence or two
    drives: tuple[str, ...]  # drives that show it
    is_refused: bool  # whether nothing can be done with the logs before it is mended

    def __str__(self) -> str:
        """Return it as one line."""
        where = f"{self.file.name}, {self.column}" if self.column else self.file.name
        more = f" (and so in {len(self.drives) - 1} more drives)" if len(self.drives) > 1 else ""
        return f"{where}: {self.words}{more}"


def merged(contradictions: Sequence[Contradiction]) -> list[Contradiction]:
    """One contradiction for each kind, in the words of the first drive that shows it, with all drives that do."""
    kinds: dict[str, list[Contradiction]] = {}
    for contradiction in sorted(contradictions, key=lambda one: not one.is_refused):
        kinds.setdefault(contradiction.kind, []).append(contradiction)
    return [
        replace(several[0], drives=tuple(dict.fromkeys(drive for one in several for drive in one.drives)))
        for several in kinds.values()
    ]


def unit_of(factor: float, units: Mapping[str, float]) -> str | None:
    """Name of the unit that explains by how much values are too small; None where none does.

    Args:
        factor: true value over the value of the log.
        units: factor of each unit.
    """
    if not factor > 0.0:
        return None
    name = min(units, key=lambda unit: abs(factor / units[unit] - 1.0))
    return name if abs(factor / units[name] - 1.0) <= NEAR_FACTOR else None
