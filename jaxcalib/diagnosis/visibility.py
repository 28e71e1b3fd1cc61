"""What drives like these could show: how strong an effect must be, what hides it, and what looks like it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxcalib.diagnosis.evidence import Signature
from jaxcalib.diagnosis.noise import NullModel

VISIBLE = 4.3  # size of a signature, in units of noise after the shift, that is seen in four of five cases
MORE_DRIVES = 3
ALIKE = 0.8


@dataclass(frozen=True)
class AtlasEntry:
    """What is known of an effect on these roads before the field is looked at.

    Attributes:
        absorption: share of its signature that a shift of the parameters explains.
        visible_from: weakest strength that would be seen in four of five cases; None if none would be.
        alike: other effects whose signatures look alike after that shift, with the cosine.
    """

    absorption: float
    visible_from: float | None
    visible_with_more: float | None = None
    alike: Mapping[str, float] = field(default_factory=dict)


def atlas_of(signatures: Mapping[str, Sequence[Signature]], null: NullModel, num_drives: int) -> dict[str, AtlasEntry]:
    """Return the atlas.

    Args:
        signatures: of all effects; of local ones and rhythms the strongest signature speaks for the rest.
        null: the null model.
        num_drives: drives in the field.
    """
    precision = np.linalg.inv(null.covariance)
    raw = np.linalg.inv(null.noise)
    chosen: dict[str, Signature] = {}
    for name, several in signatures.items():
        chosen[name] = max(
            several, key=lambda one: float(one.shift[-1] @ precision @ one.shift[-1]) / one.strengths[-1]
        )
    root = np.linalg.cholesky(precision).T
    whitened = {name: root @ one.shift[-1] for name, one in chosen.items()}
    entries = {}
    for name, one in chosen.items():
        seen = whitened[name] @ whitened[name]
        total = float(one.shift[-1] @ raw @ one.shift[-1])
        sizes = [float(np.sqrt(max(shift @ precision @ shift, 0.0))) for shift in one.shift]
        alike = {}
        for other, vector in whitened.items():
            length = np.linalg.norm(vector) * np.linalg.norm(whitened[name])
            cosine = float(vector @ whitened[name] / length) if length > 0 else 0.0
            if other != name and abs(cosine) > ALIKE:
                alike[other] = cosine
        more = np.sqrt((num_drives + MORE_DRIVES) / num_drives)
        entries[name] = AtlasEntry(
            absorption=float(np.clip(1.0 - seen / total, 0.0, 1.0)) if total > 0 else 0.0,
            visible_from=_visible_from(signatures[name], one, np.asarray(sizes), precision, VISIBLE),
            visible_with_more=_visible_from(signatures[name], one, np.asarray(sizes), precision, VISIBLE / more),
            alike=alike,
        )
    return entries


def _visibility(one: Signature, precision: np.ndarray) -> float:
    """Return how large a signature is per strength."""
    return float(one.shift[-1] @ precision @ one.shift[-1]) / float(one.strengths[-1]) ** 2


def _visible_from(
    several: Sequence[Signature], chosen: Signature, sizes: np.ndarray, precision: np.ndarray, size: float
) -> float | None:
    """Return the weakest strength whose signature has a size; of fixed signatures the weakest that has."""
    if not chosen.is_fixed:
        return _strength_of_size(chosen.strengths, sizes, size, chosen.exponent)
    visible = [one.strengths[-1] for one in several if float(one.shift[-1] @ precision @ one.shift[-1]) >= size**2]
    return float(min(visible)) if visible else None


def _strength_of_size(strengths: np.ndarray, sizes: np.ndarray, size: float, exponent: float) -> float | None:
    """Return the strength at which a signature has a size.

    A power of the strength up to the weakest that was tried, then linear, up to twice the strongest.
    """
    if sizes[-1] <= 0.0:
        return None
    if sizes[1] >= size:
        return float(strengths[1] * (size / sizes[1]) ** (1.0 / exponent))
    for place in range(2, len(sizes)):
        if sizes[place] >= size:
            low, high = sizes[place - 1], sizes[place]
            share = (size - low) / max(high - low, 1e-12) if low < size else 0.0
            return float(strengths[place - 1] + share * (strengths[place] - strengths[place - 1]))
    beyond = float(strengths[-1] * size / sizes[-1])
    return beyond if beyond <= 2.0 * strengths[-1] else None
