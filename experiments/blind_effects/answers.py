"""Labels and answers, read and put side by side."""

import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.blind_effects.run import ANSWER, case_folders, run_name
from experiments.blind_effects.seal import Label, SealBrokenError, file_hash, opened

NO_EFFECT = ("no_gap", "miscalibrated")
NAMING = ("effect", "pair", "class")


@dataclass(frozen=True)
class Answered:
    """A case with its label and what was answered."""

    folder: Path  # of the case
    label: Label  # the truth
    answer: dict[str, Any]  # diagnosis.json
    twin: dict[str, Any] | None = None  # diagnosis.json of the twin with more held-out drives, if there is one

    @property
    def kind(self) -> str:
        """Return the label's kind."""
        return str(self.label["kind"])

    @property
    def true_effects(self) -> tuple[str, ...]:
        """Return the true effects."""
        return tuple(effect["effect"] for effect in self.label["effects"])

    @property
    def level(self) -> str:
        """Return the first effect's level; empty without one."""
        return str(self.label["effects"][0].get("level", "")) if self.label["effects"] else ""

    @property
    def truth(self) -> str:
        """Return the candidate of the ranking that is right: an effect, none or unknown."""
        if self.kind in ("null", "null_far"):
            return "none"
        return self.true_effects[0] if self.kind == "single" else "unknown"

    @property
    def verdict(self) -> str:
        """Return the verdict."""
        return str(self.answer["verdict"])

    @property
    def named(self) -> tuple[str, ...]:
        """Return the effects that were named."""
        return tuple(self.answer["effects"]) if self.verdict in NAMING else ()


def read_answers(cases: Path, runs: Path, key_file: Path | None) -> tuple[list[Answered], list[str]]:
    """Return the answered cases and the names of those without an answer.

    Labels of sealed cases are in the key's file; without it each case has a label.json.

    Raises:
        SealBrokenError: a label or an answer has been changed, or a case was added or taken away.
    """
    folders = [folder for folder in case_folders(cases) if folder.parent.name != "twins"]
    labels = _sealed(cases, key_file, folders) if key_file else _open(folders)
    hashes = _json(runs / "answers.json") if (runs / "answers.json").is_file() else {}
    answered: list[Answered] = []
    missing: list[str] = []
    for folder in folders:
        file = runs / run_name(folder) / ANSWER
        if folder.name not in labels:
            continue
        if not file.is_file():
            missing.append(folder.name)
            continue
        twin = runs / f"{folder.name}_twin" / ANSWER
        for answer in (file, twin):
            name = answer.parent.name
            if key_file and answer.is_file() and name not in hashes:
                raise SealBrokenError(f"{answer}: expected its hash in answers.json, as `run` records it.")
            if name in hashes and file_hash(answer) != hashes[name]:
                raise SealBrokenError(f"{answer}: not the answer that was recorded.")
        answered.append(Answered(folder, labels[folder.name], _json(file), _json(twin) if twin.is_file() else None))
    return answered, missing


def _sealed(cases: Path, key_file: Path, folders: list[Path]) -> dict[str, Label]:
    seals = _json(cases / "seals.json")["cases"]
    gone = sorted(set(seals) - {folder.name for folder in folders})
    if gone:
        raise SealBrokenError(f"{cases}: expected a case for each seal; {', '.join(gone)} are not there.")
    for folder in folders:
        if folder.name not in seals:
            raise SealBrokenError(f"{folder}: expected a seal in {cases / 'seals.json'}.")
    return opened(seals, _json(key_file)["cases"])


def _open(folders: list[Path]) -> dict[str, Label]:
    """Return the labels that lie beside their cases; what has none is left out."""
    with_label = [folder for folder in folders if (folder / "label.json").is_file()]
    if len(with_label) < len(folders):
        warnings.warn(f"{len(folders) - len(with_label)} cases have no label.json.", stacklevel=2)
    return {folder.name: _json(folder / "label.json") for folder in with_label}


def _json(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text(encoding="utf-8"))
