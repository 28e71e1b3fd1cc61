"""What a scenario's files write, and which further files they read.

In runs nothing writes files. SUMO's reader minds no levels: a detector within any other element is built, too, and so
is one in a route file. Files that are read are named by where they lie, for what names them is written elsewhere.
"""

import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from pathlib import Path

from sim_adapters.scenario.sumo_files import read_xml, resolved

WRITING_ATTRIBUTES = ("file", "dest", "output")  # of detectors and the like: what they write, nobody reads
# They act on traffic: of these, the file is read, or the attribute alone goes.
ACTING = ("calibrator", "rerouter", "variableSpeedSign")
# Parameters of vehicles whose devices write; a device for conflicts does nothing else, and has a file by default.
WRITING_PARAMETERS = re.compile(r"(^|\.)ssm(\.|$)|\.files?$|output")


def names_in_use(roots: Iterable[ET.Element]) -> frozenset[str]:
    """Return what acts on traffic by: route probes of calibrators, detectors of traffic lights."""
    names: set[str] = set()
    for root in roots:
        names |= {one.get("routeProbe", "") for one in root.iter("calibrator")}
        for light in root.iter("tlLogic"):
            names |= {name for one in light.iter("param") for name in one.get("value", "").replace(",", " ").split()}
    return frozenset(names - {""})


def without_outputs(root: ET.Element, in_use: Collection[str] = ()) -> bool:
    """Take out of a file's elements, at all levels, what writes files; return whether there was anything.

    What something else is in use of stays, and writes nowhere.
    """
    found = False
    for parent in list(root.iter()):
        if parent.tag == "calibrator" and parent.attrib.pop("output", None) is not None:
            found = True
        for element in [element for element in parent if _only_writes(element)]:
            found = True
            if element.get("id") in in_use:
                element.attrib.update(dict.fromkeys(set(WRITING_ATTRIBUTES) & set(element.attrib), os.devnull))
            else:
                parent.remove(element)
    return found


def place_files(root: ET.Element, source: Path, folder: Path | None = None) -> bool:
    """Name by where they lie the files that a file's elements read; return whether there was anything.

    Args:
        root: of the file.
        source: where the file lies.
        folder: for people, where the files are copied to, to be named by their names; None leaves them where they lie.

    Raises:
        ScenarioError: one has no path.
    """
    found = False
    for element in root.iter():
        if element.tag in ACTING and element.get("file"):
            element.set("file", placed(resolved(source.parent / element.get("file", ""), source), folder))
            found = True
    return found


def placed(file: Path, folder: Path | None) -> str:
    """Return the name of a file that is read, copied to a folder where there is one."""
    if folder is None or not file.is_file():
        return str(file)
    name, number = file.name, 0
    while (folder / name).exists() and (folder / name).read_bytes() != file.read_bytes():
        number += 1
        name = f"{number}-{file.name}"
    shutil.copyfile(file, folder / name)
    return name


def copy_without_outputs(file: Path, folder: Path, in_use: Collection[str] = ()) -> Path:
    """A copy of a file that lets nothing write files; the file itself where it does not."""
    root = read_xml(file)
    if not without_outputs(root, in_use):
        return file
    place_files(root, file)
    copy = folder / f"{len(list(folder.iterdir()))}-{file.name.removesuffix('.gz')}"
    copy.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return copy


def _only_writes(element: ET.Element) -> bool:
    if element.tag == "param":
        return WRITING_PARAMETERS.search(element.get("key", "")) is not None
    return element.tag not in ACTING and any(name in element.attrib for name in WRITING_ATTRIBUTES)
