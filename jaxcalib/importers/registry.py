"""The formats that can be imported; a new one is a file of this package and a line here."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jaxcalib.errors import CaseError

if TYPE_CHECKING:  # the command line reads the list below at each start, and need not wait for pandas
    from jaxcalib.importers.importer import ReadRecording


@dataclass(frozen=True)
class ImporterEntry:
    """A format."""

    words: str  # what it is, in one line
    module: str  # file of this package that reads it: it has a `read_recording`
    extra: str = ""  # name of the optional dependencies that it needs


IMPORTERS: Mapping[str, ImporterEntry] = {
    "comma": ImporterEntry("openpilot's car state, radar tracks and location, as CSV or Parquet", "comma"),
    "highd": ImporterEntry("highD and exiD: recordingMeta, tracksMeta and tracks", "highd"),
    "ngsim": ImporterEntry("NGSIM's trajectories, in feet or metres", "ngsim"),
    "osi": ImporterEntry("ASAM OSI ground truth and sensor view (.mcap, .osi)", "osi", extra="osi"),
    "rosbag": ImporterEntry("ROS 1 and ROS 2 bags, MCAP: odometry or GNSS, and objects", "rosbag", extra="rosbag"),
    "sumo-fcd": ImporterEntry("SUMO's floating car data (XML, CSV, Parquet)", "sumo_fcd"),
    "trajectories": ImporterEntry("any table of vehicle, time and place, with --mapping", "trajectory_table"),
}


def load_importer(name: str) -> "ReadRecording":
    """Return the function that reads recordings of a format.

    Raises:
        CaseError: what it needs is not installed.
    """
    entry = IMPORTERS[name]
    try:
        module = importlib.import_module(f"jaxcalib.importers.{entry.module}")
    except ModuleNotFoundError as error:
        if not entry.extra:
            raise
        todo = f"expected the package {error.name}, which is not installed: pip install 'jaxcalib[{entry.extra}]'"
        raise CaseError("command line", f"import {name}", todo) from None
    return module.read_recording
