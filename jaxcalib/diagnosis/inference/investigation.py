"""From the runs to the explanations: null model, signatures, evidence; no simulator enters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import LEAST_DEVIATION, NullModel, null_model, observed_cells, on_cells
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.atlas import (
    EffectTrial,
    Slopes,
    altered_signatures,
    disagreement,
    slopes_of,
    surrogate_signatures,
)
from jaxcalib.diagnosis.inference.ledger import parameter_shift, shift_covariance
from jaxcalib.diagnosis.inference.left_out import LeftOut, left_out_sets, noise_factor, with_noise
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    Explained,
    explain,
    explain_none,
    explain_unknown,
    groups_of,
    knees_of,
    log_density,
    squeezed,
)
from jaxcalib.diagnosis.inference.ramp_inflow import explain_ramps
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.diagnosis.runs.trials import BASELINE
from jaxcalib.problem.problem import CalibrationProblem
from surrogate.effects.registry import effect_named

FEWEST_FEATURES = 20


class NotTestableError(RuntimeError):
    """The drives show too little to judge anything by."""


@dataclass(frozen=True)
class Prepared:
    """The null model for some drives, and what makes it."""

    tallies: DriveTallies  # of the drives
    null: NullModel
    difference: np.ndarray  # features of the drives less the simulation's, in units of noise
    slopes: Slopes  # change of features with the parameters, in their own units
    disagrees: np.ndarray  # by how much both simulators differ at equal values, in units of noise
    left_out: Sequence[LeftOut] = ()  # sets of drives without effect, to hold the drives' evidence against


def prepare(
    problem: CalibrationProblem,
    drives: DriveTallies,
    runs: NullRuns,
    trials: Mapping[str, DriveTallies],
    prior_steps: np.ndarray,
) -> Prepared:
    """Return the null model for drives.

    Args:
        problem: the problem.
        drives: tallies of the drives.
        runs: SUMO's runs without effect.
        trials: tallies of the parameters' trials by name.
        prior_steps: shift of each parameter that stays open, in steps, as a standard deviation.

    Raises:
        NotTestableError: too few features are observed.
    """
    cells = observed_cells(drives, runs.plain)
    if len(cells) < FEWEST_FEATURES:
        raise NotTestableError(f"{len(cells)} features are observed often enough; {FEWEST_FEATURES} are needed")
    seen = on_cells(drives, cells)
    slopes = slopes_of(problem.layout, trials, cells)
    plain, below = on_cells(runs.plain, cells), seen.below.sum(axis=0)

    more, flat = slopes.influence, LEAST_DEVIATION

    def null_of(some: DriveTallies) -> NullModel:
        return null_model(cells, below, some, slopes.slope, slopes.error, prior_steps, more, len(drives), flat)

    null = null_of(plain)
    flat = null.deviation
    left_out = left_out_sets(plain, len(drives), null_of)
    factor = noise_factor(left_out)
    null = with_noise(null, factor)
    left_out = tuple(replace(each, null=with_noise(each.null, factor)) for each in left_out)
    disagrees = disagreement(trials[BASELINE], runs.plain, null)
    return Prepared(seen, null, null.standardised(seen.values()), slopes, disagrees, left_out)


def all_signatures(
    prepared: Prepared, runs: NullRuns, trials: Sequence[EffectTrial], tallies: Mapping[str, DriveTallies]
) -> dict[str, list[Signature]]:
    """Return the signatures of all effects that were tried, in units of noise."""
    behaviour = surrogate_signatures(trials, tallies, prepared.null, prepared.disagrees)
    altered = altered_signatures(runs, prepared.null, behaviour)
    return behaviour | altered


def explanations(
    problem: CalibrationProblem,
    values: np.ndarray,
    prepared: Prepared,
    signatures: Mapping[str, Sequence[Signature]],
    num_places: Mapping[str, int],
) -> list[Explained]:
    """Evidence of each explanation on the drives to fit, best first."""
    null, difference = prepared.null, prepared.difference
    none = explain_none(difference, null)
    explained = [none, explain_unknown(difference, null, groups_of(null.cells))]
    for name, several in signatures.items():
        explained.append(explain(difference, null, several, effect_named(name).medium, num_places.get(name, 1)))
    ramps = explain_ramps(none.log_evidence, *input_ratios(problem, values, prepared))
    if ramps is not None:
        explained.append(ramps)
    return sorted(explained, key=lambda explanation: -explanation.log_evidence)


def ramp_gains(
    problem: CalibrationProblem, values: np.ndarray, prepared: Prepared, differences: np.ndarray
) -> list[float]:
    """Return the log evidence for a ramp's wrong inflow above the baseline's for each of some differences."""
    ratios = [input_ratios(problem, values, replace(prepared, difference=each)) for each in differences]
    explained = [explain_ramps(0.0, *each) for each in ratios]
    return [-np.inf if each is None else each.log_evidence for each in explained]


def input_ratios(
    problem: CalibrationProblem, values: np.ndarray, prepared: Prepared
) -> tuple[dict[int, tuple[float, float]], float]:
    """Return each ramp's calibrated inflow over the scenario's with its error, and the main entrance's ratio."""
    layout, given = problem.layout, problem.template.base_demand_vehph()
    steps = parameter_steps(layout, values)
    shifted = values + steps * parameter_shift(prepared.difference, prepared.null)
    error = steps * np.sqrt(np.maximum(np.diag(shift_covariance(prepared.null)), 0.0))
    entrance = {flow.id: flow.route[0] for flow in problem.scenario.flows}
    main = problem.scenario.demand.subject_route[0]
    is_main = [any(entrance[flow] == main for flow in flows) for flows in layout.input_flows]
    ratio = {k: (float(shifted[k] / given[k]), float(error[k] / given[k])) for k in range(layout.num_inputs)}
    mains = [ratio[k][0] for k in range(layout.num_inputs) if is_main[k]]
    return {k: pair for k, pair in ratio.items() if not is_main[k]}, float(np.mean(mains)) if mains else 1.0


def shift_in_errors(problem: CalibrationProblem, values: np.ndarray, prepared: Prepared) -> float:
    """Shift of the parameter that the calibration moved farthest, in its errors."""
    steps = parameter_steps(problem.layout, values)
    shifted = values + steps * parameter_shift(prepared.difference, prepared.null)
    error = steps * np.sqrt(np.maximum(np.diag(shift_covariance(prepared.null)), 1e-12))
    return float(np.max(np.abs(shifted - problem.template.base_values()) / error))


def gain_of(explanation: Explained, held_out: Prepared, fitted: Prepared) -> float | None:
    """Return the gain in log-likelihood per held-out drive of an explanation against the recalibrated baseline."""
    if explanation.shift is None:
        return None
    shift = transfer(explanation.shift, fitted.null, held_out.null)
    knees = knees_of(held_out.null.cells)
    judged, shift = squeezed(held_out.difference, knees), squeezed(shift, knees)
    before, _ = log_density(judged, held_out.null.covariance)
    extra = np.diag((0.5 * shift) ** 2)
    after, _ = log_density(judged - shift, held_out.null.covariance + extra)
    return (after - before) / len(held_out.tallies)


def transfer(shift: np.ndarray, of: NullModel, to: NullModel) -> np.ndarray:
    """Return a shift of features in units of another null model's noise; features that it lacks are left out."""
    known = {cell: feature for feature, cell in enumerate(of.cells)}
    moved = np.zeros(len(to.cells))
    for feature, cell in enumerate(to.cells):
        if cell in known:
            moved[feature] = shift[known[cell]] * of.deviation[known[cell]] / to.deviation[feature]
    return moved
