"""What drives like these could show: how strong an effect must be, what hides it, and what looks like it.

How strong it must be is found by judging made-up fields as the field is judged, by the least evidence of all drives
together and without each of them: differences as noise, the parameters' shift and a trace that is as unlike its
signature as the evidence allows for, and weaker or stronger, would make them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.made_up_fields import NUM_FIELDS, MadeUpFields, make_fields
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    MOST_STRENGTH,
    TRACE_ERROR,
    knees_of,
    predicted,
    squeezed,
    strengths_of,
    uncertainty,
)
from surrogate.effects.registry import effect_named

POWER = 0.8  # an effect is visible if so many of such fields would show it
# Strengths that are looked at, in units of the strongest that was tried; what is stronger is not judged either.
STRONGEST, WEAKEST = MOST_STRENGTH, 0.02
HALVINGS = 7  # of the ratio between the two: to 4 %
MORE_DRIVES = 3
ALIKE = 0.8
TINY = 1e-9  # features that stay as they are have no chance of their own


@dataclass(frozen=True)
class AtlasEntry:
    """What is known of an effect on these roads before the field is looked at."""

    absorption: float  # share of its signature that a shift of the parameters explains
    visible_from: float | None  # weakest strength that would be seen in four of five cases; None if none would be
    visible_with_more: float | None = None
    # other effects whose signatures look alike after that shift, with the cosine
    alike: Mapping[str, float] = field(default_factory=dict)


def atlas_of(
    signatures: Mapping[str, Sequence[Signature]],
    null: NullModel,
    num_drives: int,
    of_mean: float,
    num_places: Mapping[str, int],
    needed_gain: float,
) -> dict[str, AtlasEntry]:
    """Return the atlas; of local effects and rhythms the strongest signature speaks for the rest.

    Args:
        signatures: of all effects.
        null: the null model of the field.
        num_drives: drives in the field.
        of_mean: variance of the null model's mean, in units of one drive's.
        num_places: how many places and times were looked at for each local effect.
        needed_gain: the log evidence that an effect has to have above the baseline's.
    """
    precision, raw = np.linalg.inv(null.covariance), np.linalg.inv(null.noise)
    by_chance, knees = raw * null.noise, knees_of(null.cells)
    random = np.random.default_rng(1).standard_normal((len(precision) + 1, NUM_FIELDS))
    now_and_later = [make_fields(null, num_drives, of_mean, num_more) for num_more in (0, MORE_DRIVES)]

    def slope(signature: Signature) -> float:
        return float(signature.shift[-1] @ precision @ signature.shift[-1]) / signature.strengths[-1]

    chosen = {name: max(several, key=slope) for name, several in signatures.items()}
    root = np.linalg.cholesky(precision).T
    whitened = {name: root @ signature.shift[-1] for name, signature in chosen.items()}
    entries = {}
    for name, strongest in chosen.items():
        seen = whitened[name] @ whitened[name]
        total = float(strongest.shift[-1] @ raw @ strongest.shift[-1])
        alike = {}
        for other, vector in whitened.items():
            length = np.linalg.norm(vector) * np.linalg.norm(whitened[name])
            cosine = float(vector @ whitened[name] / length) if length > 0 else 0.0
            if other != name and abs(cosine) > ALIKE:
                alike[other] = cosine
        medium = effect_named(name).medium
        cost = needed_gain + np.log(max(num_places.get(name, 1), len(signatures[name])))
        now, with_more = (
            _visible_from(
                [
                    _Judge(
                        each,
                        medium,
                        fields,
                        knees,
                        cost,
                        _true_shares(each, raw, by_chance),
                    )
                    for each in (signatures[name] if strongest.is_fixed else [strongest])
                ],
                random,
            )
            for fields in now_and_later
        )
        entries[name] = AtlasEntry(
            absorption=float(np.clip(1.0 - seen / total, 0.0, 1.0)) if total > 0 else 0.0,
            visible_from=now,
            visible_with_more=with_more,
            alike=alike,
        )
    return entries


class _Judge:
    """Judges made-up fields by the evidence for one signature, as `marginal_likelihood.explain` does."""

    def __init__(
        self,
        signature: Signature,
        medium: float,
        fields: MadeUpFields,
        knees: np.ndarray,
        cost: float,
        true_shares: list[float],
    ) -> None:
        """Prepare what all fields share.

        Args:
            signature: of the effect.
            medium: its medium strength.
            fields: without the effect.
            knees: from where on differences count by their logarithm.
            cost: what evidence needs: above the baseline's, and for the places and times that were looked at.
            true_shares: what of the signature is no chance of its runs, at each known strength but 0.
        """
        self.strengths = signature.strengths
        self.is_fixed = signature.is_fixed
        self._signature, self._knees = signature, knees
        self._cost, self._true_shares = cost, true_shares
        self._fields = fields
        self._none = np.linalg.cholesky(fields.covariance)
        self._explanations = []
        for strength in strengths_of(signature, medium):
            shift, uncertain = predicted(signature, strength, knees)
            self._explanations.append((shift, np.linalg.cholesky(fields.covariance + uncertain)))

    def is_seen(self, strength: float, random: np.ndarray) -> bool:
        """Say whether the evidence of enough fields with the effect suffices, of all drives and without each of them.

        Random are standard normal numbers, [feature and 1, field]: they make what traces are unlike their signature,
        and the last row says how strong they are.
        """
        known = self.strengths[1:]
        not_true = 1.0 - np.interp(strength, known, self._true_shares)
        expected, error = self._signature.at(strength)
        uncertain = uncertainty(self._signature, expected, np.sqrt(1.0 - not_true) * error, self._knees)
        shown = strength * np.exp(TRACE_ERROR * np.mean(self._signature.exactness) * random[-1])
        true = np.interp(shown, known, self._true_shares)
        shift = true * np.stack([self._signature.at(each)[0] for each in shown], axis=1)
        traces = np.linalg.cholesky(uncertain + TINY * np.eye(len(uncertain))) @ random[:-1]
        is_enough = np.ones(NUM_FIELDS, bool)
        for chance, scale in zip(self._fields.chance, self._fields.scale, strict=True):
            fields = squeezed(scale * shift + chance, self._knees[:, None]) + scale * traces
            is_enough[is_enough] = self._gain(fields[:, is_enough]) >= 0.0
            if is_enough.mean() < POWER:
                return False
        return True

    def _gain(self, fields: np.ndarray) -> np.ndarray:
        """Return the evidence for the effect beyond what is asked of it, [field]."""
        values = [_log_density(fields - at[:, None], root) for at, root in self._explanations]
        return logsumexp(values, axis=0) - np.log(len(values)) - self._cost - _log_density(fields, self._none)


def _true_shares(signature: Signature, inverse: np.ndarray, by_chance: np.ndarray) -> list[float]:
    """Share of a measured signature that is no chance of its runs, on the average, at each known strength but 0.

    `inverse` is that of the noise, and `by_chance` the same times the noise, element by element.
    """
    shares = []
    for shift, error in zip(signature.shift[1:], signature.error[1:], strict=True):
        size = float(shift @ inverse @ shift)
        shares.append(max(1.0 - float(error @ by_chance @ error) / size, 0.0) if size > 0.0 else 0.0)
    return shares


def _log_density(differences: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return logarithms of a normal density around 0, but for a constant, at columns."""
    white = solve_triangular(root, differences, lower=True, check_finite=False)
    return -0.5 * np.sum(white**2, axis=0) - np.log(np.diag(root)).sum()


def _visible_from(several: Sequence[_Judge], random: np.ndarray) -> float | None:
    """Return the weakest strength that enough fields show; of fixed signatures the weakest that is."""
    if several[0].is_fixed:
        visible = [float(judge.strengths[-1]) for judge in several if judge.is_seen(judge.strengths[-1], random)]
        return min(visible, default=None)
    (judge,) = several
    low, high = WEAKEST * judge.strengths[-1], STRONGEST * judge.strengths[-1]
    if not judge.is_seen(high, random):
        return None
    if judge.is_seen(low, random):
        return float(low)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if judge.is_seen(middle, random) else (middle, high)
    return float(high)
