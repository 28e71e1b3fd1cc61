"""Reads SUMO's files without letting them do anything: a case from a stranger may be wrong, it may not do harm.

Document types (entities) and includes are refused, and sizes are bounded.
"""

import gzip
import xml.etree.ElementTree as ET
import zlib
from pathlib import Path
from xml.parsers import expat

from sim_adapters.errors import ScenarioError

LARGEST_UNPACKED_BYTES = 200 * 1024 * 1024
MOST_LEVELS = 100  # SUMO's files have six
GZIP_MAGIC = b"\x1f\x8b"


def read_xml(file: Path) -> ET.Element:
    """Return the root of an XML file, packed or not.

    Raises:
        ScenarioError: the file is missing, too large, has a DOCTYPE or an include, too many levels, or is not XML.
    """
    if not file.is_file():
        raise ScenarioError(file, f"expected a file at '{file}'; there is none.")
    try:
        raw = file.read_bytes()
        if raw[:2] == GZIP_MAGIC:
            with gzip.open(file) as packed:
                raw = packed.read(LARGEST_UNPACKED_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise ScenarioError(file, f"expected a file that can be read: {error}.") from None
    if len(raw) > LARGEST_UNPACKED_BYTES:
        raise ScenarioError(file, f"expected at most {LARGEST_UNPACKED_BYTES // 2**20} MiB of XML.")
    try:
        _refuse_document_type(file, raw)
        root = ET.fromstring(raw)
    except (ET.ParseError, expat.ExpatError, RecursionError, LookupError) as error:  # the last: an unknown encoding
        raise ScenarioError(file, f"expected XML: {error}.") from None
    _refuse_depth(file, root)
    if next(root.iter("include"), None) is not None:
        todo = "name that file in the configuration, or put what stands in it here."
        raise ScenarioError(file, f"expected no <include>, by which SUMO reads a file that nobody checks: {todo}")
    return root


def _refuse_document_type(file: Path, raw: bytes) -> None:
    """Parse as far as a DOCTYPE could stand, in whatever encoding the file is."""

    def refuse(*declaration: object) -> None:
        raise ScenarioError(file, "expected plain XML; found a DOCTYPE, which SUMO files never need.")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(raw, True)


def _refuse_depth(file: Path, root: ET.Element) -> None:
    """Refuse what other readers and writers of XML follow by recursion until they fail."""
    level, depth = [root], 0
    while level:
        level = [child for element in level for child in element]
        depth += 1
        if depth > MOST_LEVELS:
            raise ScenarioError(file, f"expected at most {MOST_LEVELS} levels of elements in one another.")


def resolved(file: Path, origin: Path) -> Path:
    """Return the absolute path of a file that another one names.

    Raises:
        ScenarioError: it is no path.
    """
    try:
        return file.resolve()
    except (OSError, ValueError, RuntimeError):
        raise ScenarioError(origin, f"expected a path, got '{file}'.") from None
