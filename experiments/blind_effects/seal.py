"""Labels are sealed: a hash of salt and label is published before the diagnosis, the key after it."""

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any

Label = dict[str, Any]


class SealBrokenError(ValueError):
    """A label, or an answer, is not the one that was sealed."""


def canonical(label: Label) -> str:
    """Return the one text that a label has."""
    return json.dumps(label, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def seal_of(salt: str, label: Label) -> str:
    """Return sha256(salt + canonical label) in hexadecimal."""
    return hashlib.sha256((salt + canonical(label)).encode()).hexdigest()


def new_salt() -> str:
    """Return a salt that nobody can guess."""
    return secrets.token_hex(32)


def root_of(seals: dict[str, str]) -> str:
    """Return one hash of all seals, in order of their cases' names: what to publish."""
    text = "".join(f"{name}:{seals[name]}\n" for name in sorted(seals))
    return hashlib.sha256(text.encode()).hexdigest()


def file_hash(file: Path) -> str:
    """Return sha256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def opened(seals: dict[str, str], key: dict[str, dict[str, Any]]) -> dict[str, Label]:
    """Return the labels of sealed cases, each checked against its seal; the key has `salt` and `label` of each case.

    Raises:
        SealBrokenError: a case has no key, or its label is not the one that was sealed.
    """
    labels: dict[str, Label] = {}
    for name, seal in seals.items():
        if name not in key:
            raise SealBrokenError(f"{name}: expected a key, there is none.")
        if seal_of(key[name]["salt"], key[name]["label"]) != seal:
            raise SealBrokenError(f"{name}: the label is not the one that was sealed.")
        labels[name] = key[name]["label"]
    return labels
