"""Section [log] of case.toml: names and units of the user's columns, checked key by key."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from jaxcalib.case.log_form import MAY_BE_ABSENT, LanesFrom, Reference

LARGEST = 1e20  # nanoseconds since 1970 are 2e18
Text = Annotated[str, Meta(min_length=1, max_length=200, description="text of 1 to 200 characters")]
Number = Annotated[float, Meta(ge=-LARGEST, le=LARGEST, description="a number of -1e20 to 1e20")]


class ColumnEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A column of the user's."""

    column: Text
    unit: Text | None = None
    zero: Number | None = None


Entry = Annotated[ColumnEntry, Meta(description='{ column = "..." }, and optionally unit and zero')]


class ColumnsSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The user's column for each of ours."""

    time_s: Entry | None = None
    road: Entry | None = None
    speed_limit_kmh: Entry | None = None
    speed_kmh: Entry | None = None
    yaw_rate_radps: Entry | None = None
    acceleration_mps2: Entry | None = None
    lane: Entry | None = None
    lane_offset_m: Entry | None = None
    longitude_rad: Entry | None = None
    latitude_rad: Entry | None = None
    x_m: Entry | None = None
    y_m: Entry | None = None
    edge: Entry | None = None
    position_m: Entry | None = None
    vehicle_id: Entry | None = None
    relative_x_m: Entry | None = None
    relative_y_m: Entry | None = None
    heading_deg: Entry | None = None
    length_m: Entry | None = None


AbsentColumn = Annotated[
    str, Meta(pattern=f"^({'|'.join(MAY_BE_ABSENT)})$", description=f"one of {', '.join(MAY_BE_ABSENT)}")
]


class LogSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [log]."""

    columns: ColumnsSection | None = None
    subject_columns: ColumnsSection | None = None
    object_columns: ColumnsSection | None = None
    absent: tuple[AbsentColumn, ...] = ()
    first_lane: Annotated[Literal[0, 1], Meta(description="0 or 1")] = 1
    lanes_from: Annotated[LanesFrom, Meta(description='"right" or "left"')] = "right"
    crs: Text | None = None
    reference: Annotated[Reference, Meta(description='"front", "centre" or "near_end"')] = "front"
    subject_length_m: Annotated[float, Meta(gt=0.0, le=100.0, description="a number > 0 and at most 100")] | None = None
    empty_road: bool = False
