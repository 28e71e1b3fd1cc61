"""Copies of a scenario's files in which some elements are others."""

import xml.etree.ElementTree as ET
from pathlib import Path

from sim_adapters.scenario.sumo_files import read_xml

WRITING_ATTRIBUTES = ("file", "dest", "output")  # of detectors and the like: what they write, nobody reads


def writes_output(element: ET.Element) -> bool:
    """Whether an element of an additional file does nothing but write a file of its own."""
    return any(name in element.attrib for name in WRITING_ATTRIBUTES) and element.tag not in ("calibrator", "rerouter")


def copy_without_outputs(file: Path, folder: Path) -> Path:
    """A copy of an additional file that lets nothing write files."""
    root = read_xml(file)
    for element in [element for element in root if writes_output(element)]:
        root.remove(element)
    copy = folder / f"{len(list(folder.iterdir()))}-{file.name.removesuffix('.gz')}"
    copy.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return copy
