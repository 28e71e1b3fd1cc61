"""How well each explanation agrees with the field: marginal likelihoods over strength, place and parameters.

All differences are in units of the field's noise. Under an explanation of strength s the field's difference from the
baseline is normal around the effect's signature m(s), with the null's covariance, plus what the surrogate may get
wrong of the signature: a share of its size in each feature, and the error of the runs it was measured with.

Large differences count by their logarithm. What a feature that hardly varies without an effect does at fifty times its
noise no signature tells, for it is far from linear there in parameters and strength, and one such feature would outvote
all others. Identities hold whoever drives, and count as they are.

Source: marginal likelihood for a linear model with normal nuisance parameters, e.g. Kass & Raftery (1995), JASA 90;
the discrepancy as a term of the covariance: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63; the inverse hyperbolic
sine, linear at 0 and logarithmic far from it: Johnson (1949), Biometrika 36, eq. 22.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from jaxcalib.diagnosis.features.features import Cell, Channel
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.statistics.normal import HALF_WIDTH_90

SIGNATURE_ERROR = 0.5  # of a signature's size in a feature; see docs/diagnosis.md for how it was measured
KNEE = 5.0  # in units of noise: from there on differences count by their logarithm
MOST_STRENGTH = 1.15  # of strong; beyond it a signature is not extrapolated
# Explanations and strengths are told apart by the shape of signatures that a surrogate made; its errors are alike in
# neighbouring features, which the model counts as independent. So differences between them count for less than they
# seem.
TEMPERATURE = 4.0
STRENGTHS = (0.15, 0.3, 0.5, 0.75, 1.0, 1.4, 1.8, 2.2)  # of medium, whose signatures are measured at medium and strong
FIXED_STRENGTHS = np.asarray((0.6, 1.0))
UNKNOWN_SIZES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# What the road shows of an effect is not what the simulator does: logarithm of strengths told to true ones (root mean
# square over the twelve effects that were named in docs/diagnosis.md and whose signatures are the surrogate's: 0.38).
TRACE_ERROR = 0.4
NONE, UNKNOWN = "none", "unknown"


@dataclass(frozen=True)
class Explained:
    """How one explanation fares."""

    name: str  # effect, or none, or unknown
    log_evidence: float  # logarithm of the marginal likelihood
    strength: float = 0.0  # posterior mean at the place and in the direction that agree best; 0 for none and unknown
    interval: tuple[float, float] = (0.0, 0.0)  # 90 % interval of the strength, at any place and in any direction
    setting: Mapping[str, float] | None = None  # place and time that agree best
    best_misfit: float = float("nan")  # whitened squared misfit at the best strength, and its number of features
    shift: np.ndarray | None = None  # expected signature at the posterior

    @property
    def is_effect(self) -> bool:
        """Whether it is an effect of the registry, not none or unknown."""
        return self.name not in (NONE, UNKNOWN)


def none_among(explained: Sequence[Explained]) -> Explained:
    """The explanation that nothing is missing."""
    return next(explanation for explanation in explained if explanation.name == NONE)


def best_gain(explained: Sequence[Explained]) -> float:
    """Log evidence of the best explanation less that of the baseline."""
    best = max(explanation.log_evidence for explanation in explained if explanation.name != NONE)
    return best - none_among(explained).log_evidence


def effects_above_none(explained: Sequence[Explained]) -> list[Explained]:
    """The effects that do better than nothing, in their order."""
    none = max((explanation.log_evidence for explanation in explained if explanation.name == NONE), default=-np.inf)
    return [explanation for explanation in explained if explanation.is_effect and explanation.log_evidence > none]


def log_density(difference: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Return the logarithm of a normal density around 0, and the squared whitened difference."""
    (value,), (square,) = log_densities(difference[None], covariance)
    return float(value), float(square)


def log_densities(differences: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same of several differences, [set, feature], which cost little more than one does."""
    factor = cho_factor(covariance, lower=True, check_finite=False)
    squares = np.einsum("sf,fs->s", differences, cho_solve(factor, differences.T, check_finite=False))
    log_determinant = 2.0 * float(np.log(np.diag(factor[0])).sum())
    return -0.5 * (squares + log_determinant + len(covariance) * np.log(2 * np.pi)), squares


def knees_of(cells: Sequence[Cell]) -> np.ndarray:
    """Return from where on, in units of noise, differences of each feature count by their logarithm."""
    return np.asarray([np.inf if cell.channel == Channel.IDENTITY else KNEE for cell in cells])


def squeezed(difference: np.ndarray, knees: np.ndarray) -> np.ndarray:
    """Return differences in units of noise as they are judged."""
    bent = np.isfinite(knees)
    knee = np.where(bent, knees, 1.0)
    return np.where(bent, knee * np.arcsinh(difference / knee), difference)


def explain_none(difference: np.ndarray, null: NullModel) -> Explained:
    """Evidence of the baseline alone."""
    value, square = log_density(squeezed(difference, knees_of(null.cells)), null.covariance)
    return Explained(NONE, value, best_misfit=square)


def explain_unknown(difference: np.ndarray, null: NullModel, groups: Sequence[np.ndarray]) -> Explained:
    """Evidence of something that shifts features of one group, or of all, in no known pattern."""
    values, squares = unknown_likelihoods(squeezed(difference, knees_of(null.cells))[None], null, groups)
    return Explained(UNKNOWN, float(mean_likelihood(values)[0]), best_misfit=float(squares.min()))


def unknown_likelihoods(
    judged: np.ndarray, null: NullModel, groups: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return log likelihood and squared misfit of something unknown of each kind and size, [kind, set].

    `judged` are squeezed differences, [set, feature].
    """
    both = [
        log_densities(judged, null.covariance + np.diag(group * size**2)) for group in groups for size in UNKNOWN_SIZES
    ]
    return np.stack([values for values, _ in both]), np.stack([squares for _, squares in both])


def mean_likelihood(log_values: np.ndarray) -> np.ndarray:
    """Return the logarithm of the mean over the first axis of what has these logarithms."""
    return logsumexp(log_values, axis=0) - np.log(len(log_values))


class Likelihoods(NamedTuple):
    """An effect's log likelihoods at all its strengths and places."""

    values: np.ndarray  # with the prior of each strength, [strength and place, set]
    squares: np.ndarray  # squared misfits likewise
    strengths: np.ndarray  # as they are told
    numbers: Sequence[int]  # which signature each is of
    shifts: np.ndarray  # what it would shift features by


def effect_likelihoods(
    judged: np.ndarray, null: NullModel, signatures: Sequence[Signature], medium: float
) -> Likelihoods:
    """Return an effect's likelihoods for sets of drives whose squeezed differences are `judged`, [set, feature]."""
    knees = knees_of(null.cells)
    values, squares, strengths, numbers, shifts = [], [], [], [], []
    for number, signature in enumerate(signatures):
        tried = strengths_of(signature, medium)
        for strength in tried:
            shift, uncertain = predicted(signature, strength, knees)
            value, square = log_densities(judged - shift, null.covariance + uncertain)
            values.append(value - np.log(len(tried)))
            squares.append(square)
            strengths.append(told_strength(signature, strength))
            numbers.append(number)
            shifts.append(signature.at(strength)[0])
    return Likelihoods(np.stack(values), np.stack(squares), np.asarray(strengths), numbers, np.stack(shifts))


def effect_evidence(likelihoods: Likelihoods, num_places: int) -> np.ndarray:
    """Return an effect's log evidence, [set]; `num_places` places were looked at, or those of its signatures."""
    num_signatures = likelihoods.numbers[-1] + 1
    return logsumexp(likelihoods.values, axis=0) - np.log(max(num_places, num_signatures))


def explain(
    difference: np.ndarray, null: NullModel, signatures: Sequence[Signature], medium: float, num_places: int = 1
) -> Explained:
    """Evidence of an effect, over its strengths and places.

    Args:
        difference: the field's features less the baseline's, in units of noise.
        null: the null model.
        signatures: of the effect, one for each place and time; all are equally likely beforehand.
        medium: its medium strength, on whose scale strengths are equally likely.
        num_places: how many places and times were looked at to find the signatures' ones: looking costs.
    """
    judged = squeezed(difference, knees_of(null.cells))
    likelihoods = effect_likelihoods(judged[None], null, signatures, medium)
    log_values = likelihoods.values[:, 0]
    tempered = log_values / TEMPERATURE
    posterior = np.exp(tempered - np.logaddexp.reduce(tempered))
    best = int(np.argmax(log_values))
    winner = signatures[likelihoods.numbers[best]]
    # elsewhere another direction may fit what the winner's leaves: their mean would be an effect that is nowhere
    like_winner = np.asarray([each.setting == winner.setting and each.sign == winner.sign for each in signatures])
    there = posterior * like_winner[np.asarray(likelihoods.numbers)]
    there /= there.sum()
    return Explained(
        name=signatures[0].effect,
        log_evidence=float(effect_evidence(likelihoods, num_places)[0]),
        strength=float(there @ likelihoods.strengths),
        interval=interval_90(likelihoods.strengths, posterior, open_form(winner)),
        setting=winner.setting,
        best_misfit=float(likelihoods.squares[best, 0]),
        shift=there @ likelihoods.shifts,
    )


def told_strength(signature: Signature, strength: float) -> float:
    """Return the strength that a signature stands for where it is judged at one, with its sign."""
    return signature.sign * float(signature.strengths[-1] if signature.is_fixed else strength)


def open_form(signature: Signature) -> float:
    """Return how far the form of an effect is open: rhythms and times are read off the log."""
    return 0.0 if signature.is_fixed else float(np.mean(signature.exactness))


def interval_90(strength: np.ndarray, posterior: np.ndarray, exactness: float) -> tuple[float, float]:
    """Return the 90 % interval of a strength whose posterior is known at some strengths.

    Each of them stands for what lies halfway to its neighbours, and a strength is told in the simulator's unit.
    """
    known, place = np.unique(strength, return_inverse=True)
    cumulated = np.cumsum(np.bincount(place, posterior))
    middles = 0.5 * (known[1:] + known[:-1])
    spread = 0.5 * np.diff(known).min() if len(known) > 1 else 0.0
    edges = np.concatenate([[known[0] - spread], middles, [known[-1] + spread]])
    low = edges[int(np.searchsorted(cumulated, 0.05))]
    high = edges[min(int(np.searchsorted(cumulated, 0.95)), len(known) - 1) + 1]
    wider = 1.0 + HALF_WIDTH_90 * TRACE_ERROR * exactness
    outwards = np.asarray([low / wider if low > 0.0 else low * wider, high * wider if high > 0.0 else high / wider])
    return float(outwards[0]), float(outwards[1])


def strengths_of(signature: Signature, medium: float) -> np.ndarray:
    """Return the strengths at which a signature is judged, all equally likely beforehand."""
    if signature.is_fixed:
        return FIXED_STRENGTHS * signature.strengths[-1]
    tried = np.asarray(STRENGTHS) * medium
    return tried[tried <= MOST_STRENGTH * max(signature.strengths[-1], medium)]


def predicted(signature: Signature, strength: float, knees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction of a signature at a strength, as it is judged, and the covariance of its error."""
    shift, error = signature.at(strength)
    return squeezed(shift, knees), uncertainty(signature, shift, error, knees)


def uncertainty(signature: Signature, shift: np.ndarray, error: np.ndarray, knees: np.ndarray) -> np.ndarray:
    """Covariance of what a shift that a signature predicts may be wrong by, as it is judged."""
    return prediction_error(shift, error, SIGNATURE_ERROR * signature.exactness, knees)


def prediction_error(
    shift: np.ndarray, error: np.ndarray, wrong_share: float | np.ndarray, knees: np.ndarray
) -> np.ndarray:
    """Covariance of what a predicted shift may be wrong by, as it is judged: a share of it, and its standard error."""
    wrong = wrong_share * squeezed(shift, knees)
    steepness = 1.0 / np.hypot(1.0, shift / knees)
    return np.diag(wrong**2 + (steepness * error) ** 2)


def signature_behind(several: Sequence[Signature], explanation: Explained) -> Signature:
    """Return the signature that speaks for an explanation: at its place, of its sign, of rhythms the nearest."""
    at_place = [each for each in several if dict(each.setting) == dict(explanation.setting or {})] or list(several)
    with_sign = [each for each in at_place if each.sign * explanation.strength >= 0.0] or at_place
    if not with_sign[0].is_fixed:
        return with_sign[0]
    return min(with_sign, key=lambda each: abs(each.strengths[-1] - abs(explanation.strength)))


def groups_of(cells: Sequence[Cell]) -> list[np.ndarray]:
    """Return masks of what something unknown may shift: all features, or those of one channel, role, lane, or kind."""
    masks = [np.ones(len(cells), bool)]
    keys = [
        lambda c: c.channel,
        lambda c: f"lane {c.lane}" if c.lane is not None and c.from_m is None else "",
        lambda c: "subject" if c.role == "subject" else "",
        lambda c: f"{c.measure}" if c.from_m is None else f"{c.measure} by place",
    ]
    for key in keys:
        names = [key(cell) for cell in cells]
        for name in dict.fromkeys(names):
            mask = np.asarray([other == name for other in names])
            if name and mask.sum() >= 2:
                masks.append(mask)
    return [mask.astype(float) for mask in masks]
