"""Copies of a scenario's files in which nothing writes files.

SUMO's reader minds no levels: a detector within any other element is built, too, and so is one in a route file.
"""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

from sim_adapters.scenario.sumo_files import read_xml

WRITING_ATTRIBUTES = ("file", "dest", "output")  # of detectors and the like: what they write, nobody reads
# They act on traffic: of these, the file is read, or the attribute alone goes.
ACTING = ("calibrator", "rerouter", "variableSpeedSign")
# Parameters of vehicles whose devices write; a device for conflicts does nothing else, and has a file by default.
WRITING_PARAMETERS = re.compile(r"(^|\.)ssm(\.|$)|\.files?$|output")


def without_outputs(root: ET.Element) -> bool:
    """Take out of a file's elements, at all levels, what writes files; return whether there was anything."""
    found = False
    for parent in list(root.iter()):
        if parent.tag == "calibrator" and parent.attrib.pop("output", None) is not None:
            found = True
        for element in [element for element in parent if _only_writes(element)]:
            parent.remove(element)
            found = True
    return found


def copy_without_outputs(file: Path, folder: Path) -> Path:
    """A copy of a file that lets nothing write files; the file itself where it does not."""
    root = read_xml(file)
    if not without_outputs(root):
        return file
    copy = folder / f"{len(list(folder.iterdir()))}-{file.name.removesuffix('.gz')}"
    copy.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return copy


def _only_writes(element: ET.Element) -> bool:
    if element.tag == "param":
        return WRITING_PARAMETERS.search(element.get("key", "")) is not None
    return element.tag not in ACTING and any(name in element.attrib for name in WRITING_ATTRIBUTES)
