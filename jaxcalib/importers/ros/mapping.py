"""Section [rosbag] of a user's TOML file: what the messages of a bag leave open."""

import tomllib
import typing
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from jaxcalib.errors import CaseError, quote, shorten

Text = Annotated[str, Meta(min_length=1, max_length=200, description="text of 1 to 200 characters")]
Overhang = Annotated[float, Meta(ge=0.0, le=20.0, description="a number of 0 to 20")]


class RosbagSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Section [rosbag]; topics that are not named are chosen by their types."""

    odometry: Text | None = None  # topic with the vehicle's places in a plane
    fix: Text | None = None  # topic with its places on the globe, which are taken instead of odometry if it is named
    speed: Text | None = None  # topic with its speeds, which are taken instead of odometry's if it is named
    acceleration: Text | None = None  # topic with its accelerations
    objects: Text | None = None  # topic with the objects that it saw
    # Whether objects are in the plane of odometry or in the vehicle's own frame; None: as the frames' names say.
    frame: Annotated[Literal["map", "vehicle"], Meta(description='"map" or "vehicle"')] | None = None
    # Whether the speeds of objects are over ground or relative to the vehicle's.
    speed_of: Annotated[Literal["objects", "relative"], Meta(description='"objects" or "relative"')] = "objects"
    front_overhang_m: Overhang = 3.8  # from base_link, which is the middle of the rear axle, to the front bumper


def read_section(file: Path) -> RosbagSection:
    """Read section [rosbag].

    Raises:
        CaseError: the file is no TOML, has other sections or keys, or a value of another kind.
    """
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise CaseError(file, "", f"expected TOML that can be read: {shorten(str(error), 150)}.") from None
    if set(data) != {"rosbag"} or not isinstance(data["rosbag"], dict):
        raise CaseError(file, "", "expected section [rosbag] and nothing else.")
    known = RosbagSection.__struct_fields__
    for key in data["rosbag"]:
        if key not in known:
            raise CaseError(file, f"rosbag.{shorten(key)}", f"expected no such key; the keys are {', '.join(known)}.")
    try:
        return msgspec.convert(data["rosbag"], RosbagSection)
    except msgspec.ValidationError as error:
        key = str(error).rpartition(" - at `$.")[2].rstrip("`")
        hint = typing.get_type_hints(RosbagSection, include_extras=True)[key]
        metas = [meta for part in (hint, *typing.get_args(hint)) for meta in getattr(part, "__metadata__", ())]
        expected = f"expected {metas[0].description}, got {quote(data['rosbag'][key])}."
        raise CaseError(file, f"rosbag.{key}", expected) from None
