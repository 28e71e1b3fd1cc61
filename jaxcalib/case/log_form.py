"""How the tables of drives are written: as Table 1, or with names, units, a clock and lanes of the user's."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

LanesFrom = Literal["right", "left"]
Reference = Literal["front", "centre", "near_end"]

MAY_BE_ABSENT = (
    "road", "speed_limit_kmh", "yaw_rate_radps", "acceleration_mps2", "lane", "lane_offset_m", "relative_y_m",
    "heading_deg",
)  # fmt: skip

UNITS: Mapping[str, str] = {
    "time_s": "s",
    "speed_limit_kmh": "km/h",
    "speed_kmh": "km/h",
    "yaw_rate_radps": "rad/s",
    "acceleration_mps2": "m/s^2",
    "lane_offset_m": "m",
    "longitude_rad": "rad",
    "latitude_rad": "rad",
    "x_m": "m",
    "y_m": "m",
    "position_m": "m",
    "relative_x_m": "m",
    "relative_y_m": "m",
    "heading_deg": "deg",
    "length_m": "m",
}


@dataclass(frozen=True)
class LogColumn:
    """A column of a log that stands for one of ours: ours = (its value - zero) * factor."""

    name: str  # its name in the file
    factor: float = 1.0  # from its unit to ours
    zero: float = 0.0  # the value that stands for our 0


@dataclass(frozen=True)
class LogForm:
    """How the tables of a case's drives are written."""

    subject: Mapping[str, LogColumn] = field(default_factory=dict)  # by our name; what is not there has our name
    objects: Mapping[str, LogColumn] = field(default_factory=dict)
    absent: frozenset[str] = frozenset()  # columns that the tables do not have
    first_lane: int = 1  # number of the first lane
    lanes_from: LanesFrom = "right"  # the side on which it lies, in the direction of travel
    crs: str | None = None  # coordinate reference system of x_m and y_m; None where they are the network's own
    # points of vehicles that places and distances mean: front bumpers, centres, or (of objects) the nearer bumper
    reference: Reference = "front"
    subject_length_m: float | None = None  # length of the subject vehicle; None for the nominal length
    empty_road: bool = False  # a drive without objects met nobody; otherwise nobody looked

    def with_time_zero(self, time_zero: float | None) -> "LogForm":
        """The form with another value of the time column for the scenario's 0; None leaves it."""
        if time_zero is None:
            return self
        changed = {
            table: {**columns, "time_s": replace(columns.get("time_s", LogColumn("time_s")), zero=time_zero)}
            for table, columns in (("subject", self.subject), ("objects", self.objects))
        }
        return replace(self, **changed)


TABLE_1 = LogForm()
