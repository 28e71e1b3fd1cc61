"""ASAM OSI traces: ground truth, also that inside sensor views; every vehicle is a candidate for the subject."""

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from mcap.exceptions import McapError
from mcap.reader import make_reader
from osi3.osi_object_pb2 import MovingObject
from osi_utilities import ChannelSpecification, MessageType, open_channel, timestamp_to_nanoseconds
from pyproj.exceptions import CRSError

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.trajectories import Recording, Slice
from jaxcalib.importers.virtual_probes import virtual_probes

KINDS = (MessageType.GROUND_TRUTH, MessageType.SENSOR_VIEW)  # that can be read, the better first
NEEDED = ("position", "position", "orientation", "dimension")  # what x, y, yaw and length are fields of


@dataclass(frozen=True)
class _Channel:
    """The messages of one kind that are read."""

    source: Path
    kind: MessageType
    topic: str | None = None  # None where the file has but one channel


@dataclass(frozen=True)
class _Moment:
    """A ground truth and what is around it."""

    place: str  # of the message in the file
    time_ns: int
    host: str | None  # id of the host vehicle, where there is one
    truth: Any  # GroundTruth


@dataclass
class _Tally:
    """What was met on the way through a trace."""

    num_messages: int = 0
    num_repeated: int = 0
    num_without_velocity: int = 0
    vehicles: set[str] = field(default_factory=set)
    left_out: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))  # ids by what they are


@dataclass
class _Trace:
    """The slices of a channel, and what was met when they were last read."""

    channel: _Channel
    offset: tuple[float, float, float]  # where the trace's own frame lies in the plane of places: x, y and yaw
    tally: _Tally = field(default_factory=_Tally)

    def slices(self) -> Iterator[Slice]:
        """Read the channel from its begin; times count from the first message."""
        self.tally = tally = _Tally()
        first_ns = last_ns = None
        for moment in _moments(self.channel):
            tally.num_messages += 1
            first_ns = moment.time_ns if first_ns is None else first_ns
            if last_ns is not None and moment.time_ns < last_ns:
                back_s = (last_ns - moment.time_ns) / 1e9
                expected = f"expected times that rise, got one {back_s:g} s before that of the message before."
                raise CaseError(self.channel.source, moment.place, expected)
            if moment.time_ns == last_ns:
                tally.num_repeated += 1
                continue
            last_ns = moment.time_ns
            yield self._slice(moment, (moment.time_ns - first_ns) / 1e9)
        if not tally.vehicles:
            raise CaseError(self.channel.source, "", "expected moving objects of type vehicle; there are none.")

    def _slice(self, moment: _Moment, time_s: float) -> Slice:
        vehicles = _vehicles(moment.truth)
        names = [str(vehicle.id.value) for vehicle in vehicles]
        self._count(moment.truth, names)
        state = np.asarray([_state(vehicle.base) for vehicle in vehicles], float).reshape(-1, 8)
        unknown = np.argwhere(~np.isfinite(state[:, : len(NEEDED)]))
        if len(unknown):
            row, column = unknown[0]
            place = f"{moment.place}, moving_object {names[row]}"
            raise CaseError(self.channel.source, place, f"expected numbers in base.{NEEDED[column]}; there are none.")
        x_m, y_m, yaw_rad, length_m, vx_mps, vy_mps, ax_mps2, ay_mps2 = state.T
        self.tally.num_without_velocity += int(np.isnan(vx_mps).sum())
        front_x_m = x_m + np.cos(yaw_rad) * length_m / 2.0  # places are centres of boxes
        front_y_m = y_m + np.sin(yaw_rad) * length_m / 2.0
        origin_x_m, origin_y_m, turn_rad = self.offset
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        return Slice(
            time_s=time_s,
            vehicle=np.asarray(names, str),
            x_m=origin_x_m + cos * front_x_m - sin * front_y_m,
            y_m=origin_y_m + sin * front_x_m + cos * front_y_m,
            heading_rad=yaw_rad + turn_rad,
            speed_mps=np.hypot(vx_mps, vy_mps),
            acceleration_mps2=np.cos(yaw_rad) * ax_mps2 + np.sin(yaw_rad) * ay_mps2,
            lane=np.full(len(names), np.nan),  # the place tells; OSI's lanes have names, not numbers
            length_m=length_m,
        )

    def _count(self, truth: Any, names: list[str]) -> None:
        self.tally.vehicles.update(names)
        for other in truth.moving_object:
            if other.type != MovingObject.TYPE_VEHICLE:
                kind = MovingObject.Type.Name(other.type).removeprefix("TYPE_").lower()
                self.tally.left_out[kind].add(other.id.value)
        for standing in truth.stationary_object:
            self.tally.left_out["stationary"].add(standing.id.value)


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Make virtual probes of a trace; where it names a host vehicle, that is the subject vehicle.

    Raises:
        CaseError: it is no such trace, or an object lacks its place, direction or size.
    """
    channel, said = _channel_in(source)
    first = next(_moments(channel), None)
    if first is None:
        raise CaseError(source, "", f"expected messages of {channel.kind.value}; there are none.")
    if first.host is not None and not options.subjects:
        if first.host in {str(vehicle.id.value) for vehicle in _vehicles(first.truth)}:
            options = replace(options, subjects=(first.host,))
            said.append(f"vehicle {first.host} is the trace's host vehicle, and so the only subject vehicle.")
        else:
            said.append(f"the trace's host vehicle, {first.host}, is not among its vehicles: others are chosen.")
    crs, offset = _plane_of(first.truth, options, said)
    trace = _Trace(channel, offset)
    drives, why = virtual_probes([Recording(source.stem, trace.slices, crs)], options)
    tally = trace.tally
    if tally.left_out:
        kinds = ", ".join(f"{len(ids)} {kind}" for kind, ids in sorted(tally.left_out.items()))
        said.append(f"objects that are no vehicles are left out: {kinds}.")
    if tally.num_repeated:
        said.append(f"messages left out, as their time is that of the one before: {tally.num_repeated}.")
    if tally.num_without_velocity:
        said.append(f"speeds left empty, as there is no velocity: {tally.num_without_velocity}.")
    taken = (
        f"{source.name}: {tally.num_messages} messages of {channel.kind.value}; {len(drives)} of "
        f"{len(tally.vehicles)} vehicles as subject vehicles.",
        why,
        "places are centres of boxes: half a length is added to reach the front bumpers.",
    )
    return Imported(tuple(drives), (*taken, *said))


def _channel_in(source: Path) -> tuple[_Channel, list[str]]:
    """The channel to be read, and what is to be said of others."""
    ending = source.suffix.lower()
    if not source.is_file() or ending not in (".mcap", ".osi"):
        raise CaseError(source, "", "expected a file that ends in .mcap or .osi.")
    if ending == ".mcap":
        return _channel_of_several(source)
    kind = MessageType(ChannelSpecification(source).autodetected_message_type or MessageType.UNKNOWN)
    if kind not in KINDS:
        raise CaseError(source, "", f"expected _gt_ (GroundTruth) or _sv_ (SensorView) in its name, got {kind.value}.")
    return _Channel(source, kind), []


def _channel_of_several(source: Path) -> tuple[_Channel, list[str]]:
    """The channel with most messages of ground truth, or else of sensor views."""
    try:
        with source.open("rb") as stream:
            summary = make_reader(stream).get_summary()
    except (McapError, OSError, ValueError, struct.error) as error:
        why = shorten(str(error), 100) or "it ends too early"
        raise CaseError(source, "", f"expected a whole MCAP file, perhaps this one is cut off: {why}.") from None
    if summary is None or summary.statistics is None:
        raise CaseError(source, "", "expected an MCAP file with a summary and its statistics, as OSI asks for.")
    counts: Counter[tuple[str, str]] = Counter()
    for number, channel in summary.channels.items():
        schema = summary.schemas.get(channel.schema_id)
        kind = schema.name.removeprefix("osi3.") if schema else "no schema"
        counts[channel.topic, kind] += summary.statistics.channel_message_counts.get(number, 0)
    there = [f"{shorten(topic)} ({shorten(kind)}, {count})" for (topic, kind), count in counts.most_common()]
    able = [one for kind in KINDS for one, count in counts.most_common() if count and one[1] == kind.value]
    if not able:
        expected = f"expected messages of GroundTruth or SensorView; it has {', '.join(there) or 'no channel'}."
        raise CaseError(source, "", expected)
    topic, kind = able[0]
    said = f"channel {shorten(topic)} ({kind}) is taken; there are, with numbers of messages: {', '.join(there)}."
    return _Channel(source, MessageType(kind), topic), [said] if len(there) > 1 else []


def _moments(channel: _Channel) -> Iterator[_Moment]:
    """The ground truths of a channel, in the order of its messages."""
    number = 0
    try:
        with open_channel(ChannelSpecification(channel.source, channel.kind, channel.topic)) as messages:
            for number, message in enumerate(messages, start=1):
                yield _moment(channel, f"message {number}", message)
    except CaseError:
        raise
    except (McapError, OSError, RuntimeError, ValueError) as error:
        raise CaseError(
            channel.source, f"message {number + 1}", f"expected {channel.kind.value}: {shorten(str(error), 150)}."
        ) from None


def _moment(channel: _Channel, place: str, message: Any) -> _Moment:
    truth = message
    if channel.kind is MessageType.SENSOR_VIEW:
        if not message.HasField("global_ground_truth"):
            raise CaseError(channel.source, place, "expected a global_ground_truth in the SensorView; there is none.")
        truth = message.global_ground_truth
    timed = next((one for one in (truth, message) if one.HasField("timestamp")), None)
    if timed is None:
        raise CaseError(channel.source, place, "expected a timestamp; there is none.")
    hosts = (one.host_vehicle_id.value for one in (message, truth) if one.HasField("host_vehicle_id"))
    host = next(hosts, None)
    return _Moment(place, timestamp_to_nanoseconds(timed), None if host is None else str(host), truth)


def _vehicles(truth: Any) -> list[Any]:
    return [thing for thing in truth.moving_object if thing.type == MovingObject.TYPE_VEHICLE]


def _state(base: Any) -> tuple[float, ...]:
    """Centre, yaw, length, velocity and acceleration of an object; nan for what it lacks."""

    def values(name: str, *parts: str) -> Iterator[float]:
        vector = getattr(base, name) if base.HasField(name) else None
        return (float("nan") if vector is None else getattr(vector, part) for part in parts)

    return (
        *values("position", "x", "y"), *values("orientation", "yaw"), *values("dimension", "length"),
        *values("velocity", "x", "y"), *values("acceleration", "x", "y"),
    )  # fmt: skip


def _plane_of(truth: Any, options: ImportOptions, said: list[str]) -> tuple[str | None, tuple[float, float, float]]:
    """The plane of places, which may be that of the trace's proj_string, and where the trace's own frame lies in it."""
    text, crs, offset = truth.proj_string.strip(), options.crs, (0.0, 0.0, 0.0)
    if crs is not None or not text:
        return crs, offset
    try:
        is_plane = pyproj.CRS(text).is_projected
    except CRSError:
        is_plane = False
    if is_plane:
        at = truth.proj_frame_offset
        crs, offset = text, (at.position.x, at.position.y, at.yaw)
    where = "where places are" if is_plane else "no projection: places are in the network's plane"  # "EPSG:4326" occurs
    said.append(f"the trace's proj_string, {quote(text)}, is {where}.")
    return crs, offset
