"""The fifth stage: a first verdict, and what it is judged by beside the explanations."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.answer.remarks import FEW_DRIVES, aliased_effects
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.chance import best_gains, gain_by_chance
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, ramp_gains, shift_in_errors
from jaxcalib.diagnosis.inference.left_out import differences_of
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, best_gain
from jaxcalib.diagnosis.inference.overdispersion import temperature
from jaxcalib.diagnosis.inference.pairs import Pairs, judge_pairs
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE, Verdict, judge
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from surrogate.effects.registry import EFFECTS


@dataclass(frozen=True)
class Grounds:
    """What a verdict rests on beside the explanations."""

    least_gain: float  # gain of the best explanation over the baseline that no single drive makes
    needed_gain: float  # that it has to have; see `chance`
    by_chance: float  # squared misfit that chance leaves
    shift_errors: float  # by how many of its errors the calibration moved the parameters away from the scenario's
    few_drives: bool  # whether there are too few drives to name one effect
    aliased: tuple[str, ...]  # effects that these drives cannot tell apart
    pairs: Pairs | None  # two effects at once; None where they explain no more than one does

    @property
    def is_sure_of_two(self) -> bool:
        """Whether two effects are there, of which one at least is sure."""
        return self.pairs is not None and bool(self.pairs.sure)

    @property
    def never_alone(self) -> tuple[str, ...]:
        """Effects that are not named without another one."""
        return tuple(effect.name for effect in EFFECTS) if self.few_drives else self.aliased

    def verdict_on(self, explained: Sequence[Explained]) -> Verdict:
        """The verdict on explanations."""
        sure = None if self.pairs is None else self.pairs.sure
        return judge(
            explained,
            self.least_gain - (self.needed_gain - LEAST_EVIDENCE),
            temperature(explained, self.by_chance),
            self.shift_errors,
            self.few_drives,
            self.aliased,
            sure,
        )


@dataclass(frozen=True)
class Judged:
    """A verdict on the drives to fit."""

    grounds: Grounds  # what it rests on beside the explanations
    verdict: Verdict
    # null model and features of held-out drives; None where there are none, or they show too little
    held_out: Prepared | None


def judge_drives(
    session: DiagnosisSession, baseline: Baseline, num_places: Mapping[str, int], checked: Checked
) -> Judged:
    """Judge the drives to fit; `num_places` are those that were looked at for each local effect."""
    problem, is_fit, fitted = session.problem, session.is_fit, baseline.fitted
    with session.stopwatch.time("evidence"):
        gain, pairs = best_gain(checked.explained), None
        needed = max(LEAST_EVIDENCE, gain_by_chance(fitted.left_out, fitted.null, checked.signatures, num_places))
        if gain >= needed and is_fit.sum() > 1:
            gain = min(gain, _least_gain(session, baseline, num_places, checked))
        if gain >= needed:
            pairs = judge_pairs(
                fitted.difference,
                fitted.null,
                checked.explained,
                checked.signatures,
                num_places,
                baseline.by_chance,
            )
        held_out = None
        if not is_fit.all():
            with contextlib.suppress(NotTestableError):
                held_out = baseline.prepared(baseline.field.take(~is_fit))
        grounds = Grounds(
            least_gain=gain,
            needed_gain=needed,
            by_chance=baseline.by_chance,
            shift_errors=shift_in_errors(problem, baseline.values, fitted),
            few_drives=int(is_fit.sum()) < FEW_DRIVES,
            aliased=aliased_effects(problem),
            pairs=pairs,
        )
        return Judged(grounds, grounds.verdict_on(checked.explained), held_out)


def _least_gain(
    session: DiagnosisSession, baseline: Baseline, num_places: Mapping[str, int], checked: Checked
) -> float:
    fitted = baseline.fitted
    without = differences_of(fitted.tallies, fitted.null, 1.0 / baseline.runs.plain.num_independent)[1:]
    gains = best_gains(without, fitted.null, checked.signatures, num_places)
    ramps = ramp_gains(session.problem, baseline.values, fitted, without)
    return float(np.min(np.maximum(gains, ramps)))
