"""Keeps the tallies of finished parts in RUN, so that a diagnosis that was stopped goes on where it was."""

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from jaxcalib.diagnosis.features import Cell, DriveTallies
from jaxcalib.disk import writing_to
from jaxcalib.journal import write_atomically


class Stages:
    """Finished parts, by name."""

    def __init__(self, folder: Path | None) -> None:
        """Begin or go on.

        Args:
            folder: where parts lie; None keeps nothing.
        """
        self._folder = folder
        if folder is not None:
            with writing_to(folder):
                folder.mkdir(exist_ok=True)

    def tallies(self, name: str, make: Callable[[], Mapping[str, DriveTallies]]) -> dict[str, DriveTallies]:
        """Return the tallies of a part, made only if they are not there yet.

        Args:
            name: of the part; it names all that the part depends on beside case, options and program.
            make: makes them.
        """
        if self._folder is None:
            return dict(make())
        file = self._folder / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.npz"
        known = _read(file)
        if known is not None:
            return known
        made = dict(make())
        arrays = {}
        for number, (key, tallies) in enumerate(made.items()):
            arrays[f"{number}_key"] = np.asarray(key)
            arrays[f"{number}_cells"] = np.asarray(json.dumps(tallies.cells))
            arrays[f"{number}_above"] = tallies.above
            arrays[f"{number}_below"] = tallies.below
            arrays[f"{number}_depart_s"] = tallies.depart_s
            arrays[f"{number}_run"] = np.zeros(0, int) if tallies.run is None else tallies.run
        with writing_to(self._folder):
            write_atomically(file, lambda stream: np.savez(stream, **arrays))
        return made


def _read(file: Path) -> dict[str, DriveTallies] | None:
    try:
        with np.load(file, allow_pickle=False) as part:
            found = {}
            for number in range(len(part.files) // 6):
                cells = tuple(Cell(*one) for one in json.loads(str(part[f"{number}_cells"])))
                above, below, depart_s = (part[f"{number}_{name}"] for name in ("above", "below", "depart_s"))
                run = part[f"{number}_run"] if len(part[f"{number}_run"]) else None
                found[str(part[f"{number}_key"])] = DriveTallies(cells, above, below, depart_s, run)
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile):
        return None
    return found
