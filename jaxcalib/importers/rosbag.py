"""ROS 1 and ROS 2 bags and MCAP files: a vehicle's own motion, and the objects that it saw."""

from contextlib import closing
from pathlib import Path

import numpy as np

from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.recorded_drive import recorded_drive
from jaxcalib.importers.ros.bag import chosen_topics, opened, read_topics
from jaxcalib.importers.ros.mapping import RosbagSection, read_section
from jaxcalib.importers.ros.own_motion import own_motion
from jaxcalib.importers.ros.seen_objects import seen_objects


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Read a drive from a ROS 1 .bag, the folder of a ROS 2 bag, or an .mcap or .db3 file of one.

    Raises:
        CaseError: the bag is broken or empty, lacks own motion or objects, or the mapping does not fit it.
    """
    section = RosbagSection() if options.mapping is None else read_section(options.mapping)
    with closing(opened(source)) as reader:
        chosen = chosen_topics(source, reader, section, options)
        read_topics(source, reader, chosen)
    said: list[str] = []
    own, crs = own_motion(source, chosen, section, options, said)
    objects = seen_objects(source, chosen, own, section, said)
    forward_m = section.front_overhang_m
    own = own.assign(
        x_m=own["x_m"] + forward_m * np.cos(own["heading_rad"]), y_m=own["y_m"] + forward_m * np.sin(own["heading_rad"])
    )
    said.append(
        f"front bumpers: the vehicle's own is taken {forward_m:g} m ahead of its reference point (front_overhang_m in "
        f"--mapping); objects' are half a length ahead of their middles, where they have a length."
    )
    for topic in chosen.values():
        if topic.supplied:
            said.append(
                f"{topic}: the bag has no definition; that of {topic.supplied} is taken, and fits every message."
            )
        if topic.num_unstamped:
            said.append(
                f"{topic.name}: {topic.num_unstamped} messages have no time stamp; when they were received is taken."
            )
    name = source.name if source.is_dir() else source.stem
    return Imported((recorded_drive(name, own, objects, crs, options),), tuple(said))
