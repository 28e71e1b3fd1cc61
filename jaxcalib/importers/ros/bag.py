"""A bag: how it is opened, which of its topics are taken, and their messages as rows of numbers."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, MessageDefinitionFormat

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.ros.definitions import DEFINITIONS, source_of, typestore
from jaxcalib.importers.ros.mapping import RosbagSection
from jaxcalib.importers.ros.messages import COLUMNS, DETECTION, TYPES


@dataclass
class Topic:
    """A topic of the bag, and what its messages say."""

    name: str  # as the vehicle's software calls it, such as /localization/kinematic_state
    type: str  # without "/msg"
    connections: list[Connection]  # all of the bag's with this name and type: one for each writer
    num_messages: int = 0  # by the bag's index
    num_unstamped: int = 0  # messages whose header has no time
    frames: set[str] = field(default_factory=set)  # frame_id of headers; empty as long as no message is read
    rows: list[tuple[Any, ...]] = field(default_factory=list)  # time in seconds, then the columns of its kind

    @property
    def supplied(self) -> str:
        """Package and version whose layout is supposed; empty where the bag or ROS itself defines the type."""
        first = self.connections[0]
        is_defined = first.msgdef.format != MessageDefinitionFormat.NONE or first.msgtype not in DEFINITIONS
        return "" if is_defined else source_of(first.msgtype)

    def table(self, kind: str) -> Frame:
        """The rows in the order of time."""
        table = pd.DataFrame(self.rows, columns=["time_s", *COLUMNS[kind]])
        return table.sort_values("time_s", kind="stable", ignore_index=True)

    def __str__(self) -> str:
        """Return what messages call it."""
        return f"{self.name} ({self.type})"


def opened(source: Path) -> AnyReader:
    """The reader of a ROS 1 .bag, the folder of a ROS 2 bag, or an .mcap or .db3 file of one.

    Raises:
        CaseError: it is none of these, or broken.
    """
    if source.is_dir() and not (source / "metadata.yaml").is_file():
        raise CaseError(source, "", "expected a ROS 2 bag; no metadata.yaml is here (`ros2 bag reindex` makes it).")
    if source.is_file() and source.suffix not in (".bag", ".mcap", ".db3"):
        raise CaseError(source, "", "expected a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.")
    try:
        reader = AnyReader([source], default_typestore=typestore())
        reader.open()
    except Exception as error:
        raise _broken(source, error) from None
    return reader


def _broken(source: Path, error: Exception) -> Exception:
    """The error that says what the library met: in a broken file that may be an exception of any type."""
    if isinstance(error, CaseError | MemoryError):
        return error
    why = shorten(str(error).rstrip(".") or type(error).__name__, 150)
    mend = "rosbag reindex" if source.suffix == ".bag" else "ros2 bag reindex or mcap recover"
    return CaseError(source, "", f"expected a whole bag: {why}; {mend} may mend it.")


def chosen_topics(source: Path, reader: AnyReader, section: RosbagSection, options: ImportOptions) -> dict[str, Topic]:
    """The topic of each kind: the one that the mapping names, or of the preferred type that with most messages.

    Raises:
        CaseError: the bag is empty, lacks own motion, objects or a definition, or the mapping does not fit it.
    """
    filled = _filled_topics(source, reader)
    listed = f"the bag has {', '.join(map(str, filled))}."
    chosen: dict[str, Topic] = {}
    for kind, types in TYPES.items():
        named = getattr(section, kind)
        fitting = [topic for topic in filled if topic.type in types and named in (None, topic.name)]
        if named is None:
            fitting = [topic for topic in fitting if topic.type != DETECTION]
        elif not fitting:
            found = [topic.type for topic in filled if topic.name == named]
            short = " or ".join(dict.fromkeys(one.rpartition("/")[2] for one in types))
            expected = f"expected a topic of {short}, got {found[0]}." if found else f"expected a topic; {listed}"
            raise CaseError(options.mapping or source, f"rosbag.{kind} {quote(named)}", expected)
        if fitting:
            order = list(types)
            chosen[kind] = min(fitting, key=lambda topic: (order.index(topic.type), -topic.num_messages))
    if not {"odometry", "fix"} & set(chosen):
        raise CaseError(source, "", f"expected a topic of nav_msgs/Odometry or sensor_msgs/NavSatFix; {listed}")
    if "objects" not in chosen:
        ways = f"Autoware's, derived_object_msgs/ObjectArray, or {DETECTION} if --mapping names it"
        raise CaseError(source, "", f"expected a topic of objects ({ways}); {listed}")
    for topic in chosen.values():
        if topic.connections[0].msgtype not in reader.typestore.fielddefs:
            expected = f"expected the definition of {topic.type}, which this bag lacks: convert it to MCAP"
            raise CaseError(source, topic.name, f"{expected} (`ros2 bag convert`) where that package is installed.")
    return chosen


def _filled_topics(source: Path, reader: AnyReader) -> list[Topic]:
    """The topics that have messages."""
    topics: dict[tuple[str, str], Topic] = {}
    for connection in reader.connections:
        message_type = connection.msgtype.replace("/msg/", "/")
        topic = topics.setdefault((connection.topic, message_type), Topic(connection.topic, message_type, []))
        topic.connections.append(connection)
        topic.num_messages += connection.msgcount
    filled = [topic for _, topic in sorted(topics.items()) if topic.num_messages]
    if not filled:
        raise CaseError(source, "", "expected messages; the bag is empty.")
    return filled


def read_topics(source: Path, reader: AnyReader, chosen: Mapping[str, Topic]) -> None:
    """Go through the messages once, and keep of each nothing but numbers.

    Raises:
        CaseError: the bag is broken, or messages are of another version.
    """
    begin_ns = reader.start_time  # seconds since then have more digits than those since 1970
    for kind, received_ns, message in _messages(source, reader, chosen):
        topic = chosen[kind]
        try:
            stamp = message.header.stamp
            stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
            topic.num_unstamped += stamp_ns == 0
            topic.frames.add(message.header.frame_id.strip("/"))
            time_s = ((stamp_ns or received_ns) - begin_ns) * 1e-9
            topic.rows += [(time_s, *row) for row in TYPES[kind][topic.type](message)]
        except AttributeError as error:
            raise CaseError(source, str(topic), f"expected another version of these messages: {error}.") from None
    for topic in chosen.values():
        if not topic.frames:
            raise CaseError(source, str(topic), f"expected {topic.num_messages} messages, as indexed; there are none.")


def _messages(source: Path, reader: AnyReader, chosen: Mapping[str, Topic]) -> Iterator[tuple[str, int, Any]]:
    """Kind, time of reception and content of every message, in the order of the bag."""
    kinds = {connection.id: kind for kind, topic in chosen.items() for connection in topic.connections}
    connections = [connection for topic in chosen.values() for connection in topic.connections]
    try:
        for connection, received_ns, raw in reader.messages(connections):
            kind, message_type = kinds[connection.id], connection.msgtype
            if chosen[kind].supplied:
                message = _as_supposed(source, reader, chosen[kind], raw)
            else:
                message = reader.deserialize(raw, message_type)
            yield kind, received_ns, message
    except Exception as error:
        raise _broken(source, error) from None


def _as_supposed(source: Path, reader: AnyReader, topic: Topic, raw: bytes) -> Any:
    """The content of a message whose layout is supposed; its length has to bear that out to the last byte."""
    store, message_type = reader.typestore, topic.connections[0].msgtype
    try:
        message = reader.deserialize(raw, message_type)
        num_bytes = 4 + store.get_msgdef(message_type).getsize_cdr(0, message, store)  # 4: what precedes the values
        if num_bytes <= len(raw) <= math.ceil(num_bytes / 4) * 4:  # some senders fill the last four bytes up
            return message
    except MemoryError:
        raise
    except Exception:  # with a wrong layout anything is taken for a length, and then anything can happen
        pass
    expected = f"expected messages laid out as in {topic.supplied}, for the bag has no definition: convert it to MCAP"
    raise CaseError(source, str(topic), f"{expected} (`ros2 bag convert`) where its own version is installed.")
