"""Keeps the tallies of finished parts in RUN, so that a diagnosis that was stopped goes on where it was."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from jaxcalib.diagnosis.features.features import Cell, DriveTallies
from jaxcalib.runs.parts import Parts


class FinishedParts:
    """Finished parts, by name."""

    def __init__(self, folder: Path | None) -> None:
        """Begin or go on in a folder; None keeps nothing."""
        self._parts = None if folder is None else Parts.begin(folder)

    def tallies(self, name: str, make: Callable[[], Mapping[str, DriveTallies]]) -> dict[str, DriveTallies]:
        """Return the tallies of a part, made only if they are not there yet.

        Its name says all that it depends on beside case, options and program.
        """
        if self._parts is None:
            return dict(make())
        file_name = f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.npz"
        known = self._parts.read(file_name, _load)
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
        self._parts.write(file_name, lambda stream: np.savez(stream, **arrays))
        return made


def _load(file: Path) -> dict[str, DriveTallies]:
    with np.load(file, allow_pickle=False) as part:
        tallies = {}
        for number in range(len(part.files) // 6):
            cells = tuple(Cell.from_json(values) for values in json.loads(str(part[f"{number}_cells"])))
            above, below, depart_s = (part[f"{number}_{name}"] for name in ("above", "below", "depart_s"))
            run = part[f"{number}_run"] if len(part[f"{number}_run"]) else None
            tallies[str(part[f"{number}_key"])] = DriveTallies(cells, above, below, depart_s, run)
    return tallies
