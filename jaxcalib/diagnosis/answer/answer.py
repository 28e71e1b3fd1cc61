"""The diagnosis as it is handed over and written to diagnosis.json."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from jaxcalib.diagnosis.inference.sumo_check import Check

FORMAT = 1
LISTED_ENTRIES = 40


@dataclass(frozen=True)
class Ranked:
    """One explanation."""

    effect: str  # name, none or unknown
    probability: float
    strength: float | None = None  # estimate in the effect's unit; None for none and unknown
    strength_ci90: tuple[float, float] | None = None  # its interval
    absorption: float | None = None  # share of its signature that recalibration explains
    held_out_gain: float | None = None  # gain in log-likelihood per held-out drive against the recalibrated baseline
    log_evidence: float = 0.0  # natural logarithm of its evidence against the baseline's
    place_and_time: Mapping[str, float] = field(default_factory=dict)  # where and when, for local effects
    # other effects that look alike here, with the cosine of their signatures
    alike: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class WhereEntry:
    """One part of the gap; the shares of all add up to 1, `gap` to the gap above noise."""

    mop: str
    regime: str
    role: str
    lane: int | None
    route_from_m: float
    route_to_m: float
    time_from_s: float | None
    time_to_s: float | None
    gap: float
    share: float
    p_adjusted: float
    field: float | None = None
    simulated: float | None = None
    difference_in_noise: float | None = None


@dataclass(frozen=True)
class Second:
    """An effect that explains part of what the first leaves."""

    effect: str  # its name
    log_evidence: float  # natural logarithm of its evidence against that of the first alone
    strength: float  # estimate, in the effect's unit


@dataclass(frozen=True)
class Diagnosis:
    """What a diagnosis found; see docs/diagnose.md.

    Attributes:
        verdict: no_gap, miscalibrated, effect, pair, class, unknown or not_testable.
        effects: the effect, two that are both there, or those that cannot be told apart.
        reason: the verdict in a sentence.
        ranking: all explanations, best first.
        where: parts of the gap, largest first.
        how_far: gaps on held-out drives; values are None where none was held out.
        checked_in_sumo: effects that were put into SUMO itself, and how its signatures agree with the surrogate's.
        second_effect: the second of two effects that are both there; None otherwise.
        next_steps: what to try next, in sentences.
        undetectable_below: for each effect the strength below which it would go unseen; None where no strength shows.
        visible_with_three_more_drives: the same with three drives more.
        parameters: values of the scenario, calibrated ones, and, where an effect was fitted again, those beside it.
        not_testable: effects that could not be judged, with the reason.
        warnings: what a user should know.
        runs: numbers of runs.
        wall_s: time of each part.
        profile: with `--profile` where the time has gone by kind of work; None otherwise.
    """

    verdict: str
    effects: tuple[str, ...]
    reason: str
    ranking: Sequence[Ranked]
    where: Sequence[WhereEntry]
    how_far: Mapping[str, Any]
    checked_in_sumo: Sequence[Check]
    second_effect: Second | None
    next_steps: Sequence[str]
    undetectable_below: Mapping[str, float | None]
    visible_with_three_more_drives: Mapping[str, float | None]
    parameters: Mapping[str, Mapping[str, float]]
    not_testable: Mapping[str, str]
    warnings: Sequence[str]
    runs: Mapping[str, int]
    wall_s: Mapping[str, float]
    profile: Mapping[str, Any] | None = None

    def to_json(self) -> str:
        """Return the text of diagnosis.json."""
        return json.dumps({"format": FORMAT} | _plain(asdict(self)), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """Return a value with numbers that JSON knows; what is not finite becomes null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        return int(value)
    number = float(value)
    return float(f"{number:.6g}") if np.isfinite(number) else None
