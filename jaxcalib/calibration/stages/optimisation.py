"""SAGA on the critical parameters, and the joint polish of all that the data can move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.stages.screening import SHORTLIST_RUNS
from jaxcalib.calibration.stages.search_box import SearchBox
from jaxcalib.calibration.stages.search_run import Judged, SearchRun, best_of
from jaxcalib.runs.seeds import GENERATION_OFFSET, SHORTLIST_OFFSET
from jaxcalib.search import SagaConfig, SagaInfo, TrustRegionConfig, TrustRegionInfo, saga, trust_region
from jaxcalib.search.evaluated_points import EvaluatedPoints, append_points

NUM_SHORTLISTED = 3
STEP_FRACTIONS = (0.3, 0.6, 1.0)  # of a Gauss-Newton step


@dataclass(frozen=True)
class Optimisation:
    """Result of a search.

    Attributes:
        best: best point in the unit cube.
        best_accuracy: its accuracy as the search saw it.
        generations: what each generation or iteration reported.
        rounds: all candidates.
    """

    best: Float[np.ndarray, " parameter"]
    best_accuracy: float
    generations: tuple[SagaInfo | TrustRegionInfo, ...]
    rounds: tuple[Judged, ...]


def optimise(
    run: SearchRun,
    box: SearchBox,
    initial_candidates: Float[np.ndarray, "candidate parameter"],
    num_runs: int,
    config: SagaConfig,
    seed: int,
    stage: str,
) -> Optimisation:
    """Search the critical parameters with SAGA.

    Args:
        run: evaluator and objective.
        box: critical parameters and their bounds.
        initial_candidates: in the unit cube, for the first generation.
        num_runs: runs per candidate.
        config: options of SAGA.
        seed: of SAGA's random numbers.
        stage: name for the record.

    Source: Algorithm 3.
    Deviation: each generation runs on seeds of its own, and the result is the best of a shortlist that is run longer.
    """
    first = np.unique(box.box_of(initial_candidates), axis=0)[: config.population_size]
    state = saga.init(len(box.chosen), seed, first, config)
    reports: list[SagaInfo] = []
    rounds: list[Judged] = []
    while not state.status.is_final:
        offset = GENERATION_OFFSET * (len(reports) + 1)  # elites must prove themselves on the seeds of each generation
        rounds.append(run.judge(box.unit_of(saga.ask(state)), num_runs, stage, offset))
        state, info = saga.tell(state, rounds[-1].accuracy, rounds[-1].is_ok)
        reports.append(info)
    few = [initial_candidates[:1], best_of(rounds[-1:], NUM_SHORTLISTED)]
    if state.best_candidate is not None:
        few.append(box.unit_of(state.best_candidate[None]))
    shortlist = run.shortlist(np.vstack(few), SHORTLIST_RUNS * num_runs, stage, SHORTLIST_OFFSET)
    best = shortlist.best
    return Optimisation(shortlist.unit[best], float(shortlist.accuracy[best]), tuple(reports), (*rounds, shortlist))


def polish_config(radius: float, num_iterations: int = 1) -> TrustRegionConfig:
    """Return the options of a polish that begins with a radius, as a share of its box.

    With many parameters the noise of slopes makes whole steps too long, so parts of them are tried as well.
    """
    return TrustRegionConfig(
        num_iterations=num_iterations, design="two_level", initial_radius=radius, step_fractions=STEP_FRACTIONS
    )


def polish(
    run: SearchRun,
    box: SearchBox,
    start: Float[np.ndarray, " parameter"],
    num_runs: int,
    config: TrustRegionConfig,
    stage: str,
    known: Sequence[Judged] = (),
) -> Optimisation:
    """Improve a point with Gauss-Newton steps on the residuals, all parameters of the box at once.

    Args:
        run: evaluator and objective.
        box: parameters and their bounds.
        start: in the unit cube.
        num_runs: runs per candidate.
        config: options of the trust region.
        stage: name for the record.
        known: candidates of earlier stages; those near the centre help to fit the surface.

    Source: not in the paper, which never measures Stage 1 again after Stage 2 has moved the driver parameters.
    """
    state = trust_region.init(box.box_of(start[None])[0], config, _evaluated(run, box, known, num_runs))
    reports: list[TrustRegionInfo] = []
    rounds: list[Judged] = []
    while not state.status.is_final:
        judged = run.judge(box.unit_of(trust_region.ask(state)), num_runs, stage)
        rounds.append(judged)
        residuals = np.where(judged.is_ok[:, None], judged.residuals, np.nan)
        state, info = trust_region.tell(state, residuals, np.ones(residuals.shape[1]), is_ok=judged.is_ok)
        reports.append(info)
    best = box.unit_of(state.center[None])[0]
    misfit = reports[-1].center_misfit if reports else np.nan
    return Optimisation(best, float(misfit), tuple(reports), tuple(rounds))


def _evaluated(run: SearchRun, box: SearchBox, known: Sequence[Judged], num_runs: int) -> EvaluatedPoints | None:
    """Return earlier candidates that lie in the box, by the present objective, weighted by their runs."""
    evaluated = None
    for judged in known:
        residuals = run.objective.residuals(judged.unit, judged.pooled, num_runs)
        is_counted = box.holds(judged.unit) & np.isfinite(residuals).all(axis=1)
        weights = np.full_like(residuals, judged.num_runs / num_runs)
        evaluated = append_points(evaluated, box.box_of(judged.unit), residuals, weights, is_counted)
    return evaluated if evaluated is not None and len(evaluated.points) else None
