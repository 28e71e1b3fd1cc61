"""Trials that are finished, a JSON file each, so that the same command goes on where it was stopped.

A trial counts for the program, the attack's code and the seed that it was made with alone: where one of these is
another one now, it is made again.
"""

import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from experiments.faults.attack import Attack, Trial
from experiments.results.terminal import write_json
from jaxcalib.runs.run_folder import identify_program

MADE_BY = "made_by"
HERE = Path(__file__).parent
NO_PART = ("__main__.py", "registry.py", "study.py", "kept_trials.py")
AN_ATTACK = "\nATTACK = "


class KeptTrials:
    """The finished trials of one attack."""

    def __init__(self, folder: Path, attack: Attack, seed: int) -> None:
        """Keep the place, and what trials depend on."""
        self._folder = folder
        self._made_by = {"seed": seed, "program": identify_program(), "attack": _code_of(attack)}

    def read(self) -> Mapping[int, Trial]:
        """Return those that count, by number."""
        found: dict[int, Trial] = {}
        for file in sorted(self._folder.glob("*.json")):
            try:
                content = json.loads(file.read_text(encoding="utf-8"))
                made_by = content.pop(MADE_BY)
                trial = Trial(**content)
            except (OSError, ValueError, KeyError, TypeError, AttributeError):
                continue  # it is made again, and its file replaced
            if made_by == self._made_by:
                found[trial.number] = trial
        return found

    def write(self, trial: Trial) -> None:
        """Keep a trial; one that could not be made is not kept, so that it is tried again."""
        if trial.ending != "not run":
            write_json(self._folder / f"{trial.number:05d}.json", {**asdict(trial), MADE_BY: self._made_by})


def _code_of(attack: Attack) -> str:
    """Digest of all code of this package that an attack's trials may depend on: its own, and what attacks share."""
    own = Path(inspect.getfile(attack.trials))
    files = [file for file in sorted(HERE.glob("*.py")) if file == own or not _is_others(file)]
    files += sorted(own.parent.rglob("*.py")) if HERE in own.parent.parents else [own]
    return hashlib.sha256(b"\0".join(each.read_bytes() for each in files)).hexdigest()


def _is_others(file: Path) -> bool:
    """Whether a module is another attack, or has no part in making trials."""
    return file.name in NO_PART or AN_ATTACK in file.read_text(encoding="utf-8")
