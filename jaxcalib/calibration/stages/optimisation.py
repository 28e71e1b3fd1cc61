"""A search of some parameters by an optimiser of the registry, and the joint polish of all that the data can move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import f as f_distribution

from jaxcalib.calibration.stages.screening import SHORTLIST_RUNS
from jaxcalib.calibration.stages.search_box import SearchBox, search_box
from jaxcalib.calibration.stages.search_run import Judged, SearchRun, best_of
from jaxcalib.runs.seeds import GENERATION_OFFSET, SHORTLIST_OFFSET
from jaxcalib.search.least_squares.response_surface import ResponseSurface
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told
from jaxcalib.search.optimisers.trust_region import TrustRegion
from jaxcalib.search.trust_region.records import TrustRegionConfig

NUM_SHORTLISTED = 3
BATCH_SIZE = 16  # candidates that the surrogate runs in about the time of one
MANY = 10_000  # candidates: the polish ends with its iterations
SIGNIFICANT = 0.05  # chance of an F statistic, where nothing can be gained, beyond which a polish goes on
STEP_FRACTIONS = (0.3, 0.6, 1.0)  # of a Gauss-Newton step


@dataclass(frozen=True)
class Optimisation:
    """Result of a search."""

    best: Float[np.ndarray, " parameter"]  # best point in the unit cube
    best_accuracy: float  # its accuracy as the search saw it
    infos: tuple[RoundInfo, ...]  # what the optimiser said of each round
    rounds: tuple[Judged, ...]  # all candidates
    # of a polish: whether it moved from a point whose residuals, beyond chance, the parameters could still lower
    is_on_its_way: bool = False


def optimise(
    run: SearchRun, box: SearchBox, optimiser: Optimiser, setting: Setting, num_runs: int, stage: str
) -> Optimisation:
    """Search the parameters of a box with an optimiser.

    Args:
        run: evaluator and objective.
        box: parameters and their bounds; its centre is the start.
        optimiser: what asks for candidates.
        setting: what it knows before it begins, in the box.
        num_runs: runs per candidate.
        stage: name for the record.

    Source: Algorithm 3 where the optimiser is SAGA.
    Deviation: the result is the best of a shortlist that is run longer, on seeds of its own.
    """
    course = _follow(run, box, optimiser, setting, num_runs, stage)
    few = [box.held[None], best_of(course.rounds[-1:], NUM_SHORTLISTED)]
    if course.best is not None:
        few.append(box.unit_of(course.best[None]))
    shortlist = run.shortlist(np.vstack(few), SHORTLIST_RUNS * num_runs, stage, SHORTLIST_OFFSET)
    best = shortlist.best
    rounds = (*course.rounds, shortlist)
    return Optimisation(shortlist.unit[best], float(shortlist.accuracy[best]), tuple(course.infos), rounds)


def polish_config(radius: float) -> TrustRegionConfig:
    """Return the options of a polish that begins with a radius, as a share of its box.

    With many parameters the noise of slopes makes whole steps too long, so parts of them are tried as well.
    """
    return TrustRegionConfig(num_iterations=1, design="two_level", initial_radius=radius, step_fractions=STEP_FRACTIONS)


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
    setting = Setting(
        len(box.chosen),
        MANY,
        BATCH_SIZE,
        box.box_of(start[None])[0],
        False,
        0,
        known=known_in(run, box, known, num_runs),
    )
    course = _follow(run, box, TrustRegion(config), setting, num_runs, stage)
    last = course.infos[-1]
    best = start if last.best is None else box.unit_of(last.best[None])[0]
    moved = any(info.details.is_accepted for info in course.infos)
    surfaces = [info.details.surface for info in course.infos if info.details.surface is not None]
    leads_on = moved and bool(surfaces) and could_be_lower(surfaces[-1])
    return Optimisation(best, course.best_accuracy, tuple(course.infos), tuple(course.rounds), leads_on)


def could_be_lower(surface: ResponseSurface) -> bool:
    """Return whether parameters explain more of the residuals at a centre than so many random directions would.

    The F test of a regression of the residuals on their slopes: at the best point they lie across all slopes but for
    chance, also where the simulator cannot show what the field does and something remains.

    Args:
        surface: linear response of the whitened residuals.

    Source: Bates & Watts (1988), Nonlinear Regression Analysis and Its Applications, ch. 2.2.3, whose criterion of
        convergence is the same quotient below a constant; here the constant is a quantile of what chance does.
    """
    answers = (surface.slope != 0.0).any(axis=1)  # what no parameter moves says nothing
    slope, residual = surface.slope[answers], surface.intercept[answers]
    num_parameters = int(np.linalg.matrix_rank(slope)) if answers.any() else 0
    num_free = len(residual) - num_parameters
    if not num_parameters or num_free < 1:
        return False
    explained = slope @ np.linalg.lstsq(slope, residual, rcond=None)[0]
    rest = float(np.sum((residual - explained) ** 2)) / num_free
    quotient = float(np.sum(explained**2)) / num_parameters / max(rest, np.finfo(float).tiny)
    return bool(f_distribution.sf(quotient, num_parameters, num_free) < SIGNIFICANT)


def polish_on(
    run: SearchRun,
    start: Float[np.ndarray, " parameter"],
    half_width: Float[np.ndarray, " parameter"],
    num_runs: int,
    config: TrustRegionConfig,
    stage: str,
    known: Sequence[Judged] = (),
    most: int = 1,
) -> tuple[Optimisation, SearchBox]:
    """Polish all parameters, and again from where that led, as long as the residuals say that more can be gained.

    A step ends at the border of the region in which slopes are trusted, and the goal may lie beyond it.

    Args:
        run: evaluator and objective.
        start: in the unit cube.
        half_width: how far around a point each parameter is searched.
        num_runs: runs per candidate.
        config: options of the trust region of each polish.
        stage: name for the record.
        known: candidates of earlier stages; those near a centre help to fit its surface.
        most: polishes at most.

    Returns:
        All polishes as one, and the box of the last.
    """
    best, done, seen = start, [], list(known)
    while True:
        box = search_box(best, range(len(best)), half_width)
        done.append(polish(run, box, best, num_runs, config, stage, seen))
        best, seen = done[-1].best, [*seen, *done[-1].rounds]
        if len(done) == most or not done[-1].is_on_its_way:
            break
    infos, rounds = (tuple(one for part in done for one in getattr(part, name)) for name in ("infos", "rounds"))
    return Optimisation(best, done[-1].best_accuracy, infos, rounds, done[-1].is_on_its_way), box


def known_in(run: SearchRun, box: SearchBox, known: Sequence[Judged], num_runs: int) -> Told | None:
    """Return earlier candidates that lie in a box, by the present objective; None where there are none.

    Args:
        run: with the objective.
        box: where they must lie.
        known: the candidates.
        num_runs: runs of a candidate that weighs 1.
    """
    together = None
    for judged in known:
        residuals = run.objective.residuals(judged.unit, judged.pooled, num_runs)
        is_counted = box.holds(judged.unit) & np.isfinite(residuals).all(axis=1)
        told = Told(
            points=box.box_of(judged.unit)[is_counted],
            accuracy=run.objective.accuracy(residuals[is_counted]),
            residuals=residuals[is_counted],
            weight=np.full(int(is_counted.sum()), judged.num_runs / num_runs),
        )
        together = told.joined(together)
    return together if together is not None and len(together.points) else None


@dataclass
class _Course:
    """What came of an optimiser's questions."""

    infos: list[RoundInfo]  # what it said of each round
    rounds: list[Judged]  # all candidates
    # best candidate as it was asked, in the box; None while all have failed
    best_seen: Float[np.ndarray, " parameter"] | None = None
    best_accuracy: float = -np.inf

    @property
    def best(self) -> Float[np.ndarray, " parameter"] | None:
        """The optimiser's own answer, in the box, or else the best candidate; None while all have failed."""
        answer = self.infos[-1].best if self.infos else None
        return self.best_seen if answer is None else answer


def _follow(
    run: SearchRun, box: SearchBox, optimiser: Optimiser, setting: Setting, num_runs: int, stage: str
) -> _Course:
    """Evaluate what an optimiser asks until it has nothing more to gain or its evaluations are used up."""
    course, state, num_left = _Course([], []), optimiser.init(setting), setting.num_evaluations
    while num_left > 0 and len(points := optimiser.ask(state)[:num_left]):
        offset = 0 if optimiser.compares_rounds else GENERATION_OFFSET * (len(course.rounds) + 1)
        judged = run.judge(box.unit_of(points), num_runs, stage, offset)
        course.rounds.append(judged)
        num_left -= len(points)
        accuracy = np.where(judged.is_ok, judged.accuracy, -np.inf)
        if accuracy.max() > course.best_accuracy:
            course.best_seen, course.best_accuracy = points[int(np.argmax(accuracy))], float(accuracy.max())
        if num_left <= 0 and len(points) < len(optimiser.ask(state)):
            break  # a round that was cut short is not told: it is the last
        residuals = np.where(judged.is_ok[:, None], judged.residuals, np.nan)
        state, info = optimiser.tell(state, Told(points, judged.accuracy, residuals))
        course.infos.append(info)
        if info.status.is_final:
            break
    return course
