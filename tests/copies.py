"""Copies of the corridor that a test may alter."""

import re
import shutil
from pathlib import Path

from tests.places import CORRIDOR


def copy_corridor(folder: Path, *drives: str) -> Path:
    """Copy the corridor into a folder that is not there yet, with the named ones of its drives alone; return the copy.

    Reading and measuring a drive takes a third of a second.
    """
    logs = tuple(f"{drive}_" for drive in drives)

    def others(place: str, names: list[str]) -> list[str]:
        return [name for name in names if Path(place).name == "field" and not name.startswith(logs)]

    shutil.copytree(CORRIDOR, folder, ignore=others)
    case = folder / "case.toml"
    head, *tables = re.split(r"(?=\[\[drive\]\])", case.read_text())
    chosen = [table for table in tables if any(f'"{drive}"' in table for drive in drives)]
    assert len(chosen) == len(drives)
    case.write_text(head + "".join(chosen))
    return folder
