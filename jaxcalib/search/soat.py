"""Simulation-based orthogonal array testing (SOAT), the paper's Algorithm 1, as init / ask / tell.

state = soat.init(orthogonal_array(12, 4), lower, upper, initial_point)
while not state.status.is_final:
    candidates = soat.ask(state)[:chunk]
    state, info = soat.tell(state, accuracy_of(candidates))
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxcalib.search.evaluation import FAILED_ACCURACY, SearchStatus, is_successful
from jaxcalib.search.orthogonal_arrays.orthogonal_array import OrthogonalArray


@dataclass(frozen=True)
class SoatConfig:
    """Options of SOAT."""

    accuracy_threshold: float = 0.8  # a_thre; reaching it is reported, and ends a literal search
    literal: bool = False  # run Algorithm 1 as printed


@dataclass(frozen=True)
class SoatState:
    """What the next step needs."""

    config: SoatConfig  # options
    array: OrthogonalArray  # the design; its factors are the parameters
    level_values: Float[np.ndarray, "parameter level"]  # the values V_j of each parameter
    # one case per row: the cases of the array in order, then the initial point, if it is tested
    candidates: Float[np.ndarray, "case parameter"]
    accuracy: Float[np.ndarray, " case"]  # accuracy of each case; nan if it failed or was not told yet
    num_told: int  # how many leading cases have been told
    status: SearchStatus  # where the search stands

    @property
    def array_accuracy(self) -> Float[np.ndarray, " case"]:
        """Accuracy of the cases of the array alone, without the initial point: what range analysis needs."""
        return self.accuracy[: self.array.num_cases]


@dataclass(frozen=True)
class SoatInfo:
    """What a person wants to see."""

    best_case: int | None  # row of the best candidate; None if there is none yet
    best_candidate: Float[np.ndarray, " parameter"] | None  # c_best
    best_accuracy: float  # a_max; -inf (literal: 0) if there is no best candidate yet
    is_initial_point_best: bool  # whether no case of the array was better than the initial point
    is_threshold_reached: bool  # whether the best accuracy is at least the threshold
    num_told: int  # cases told so far
    num_failed: int  # how many of them failed
    status: SearchStatus  # where the search stands


def level_values(
    lower: Float[np.ndarray, " parameter"], upper: Float[np.ndarray, " parameter"], num_levels: int
) -> Float[np.ndarray, "parameter level"]:
    """Return equidistant values of each parameter, both bounds included.

    Args:
        lower: lower bounds.
        upper: upper bounds, greater than the lower ones.
        num_levels: l_j >= 2, the same for every parameter.

    Raises:
        ValueError: the bounds do not fit one another.

    Source: Eq. 8.
    """
    if lower.ndim != 1 or lower.shape != upper.shape:
        raise ValueError(f"Expected two vectors of bounds of equal length; got {lower.shape} and {upper.shape}.")
    bad = np.flatnonzero(~(np.isfinite(lower) & np.isfinite(upper) & (lower < upper)))
    if bad.size:
        j = int(bad[0])
        raise ValueError(f"Expected finite bounds lower < upper; got {lower[j]} and {upper[j]} for parameter {j}.")
    return np.linspace(lower, upper, num_levels, axis=1)


def points_from_levels(
    values: Float[np.ndarray, "parameter level"], levels: Int[np.ndarray, "case parameter"]
) -> Float[np.ndarray, "case parameter"]:
    """Return the parameter values that belong to levels, one case per row."""
    return values[np.arange(values.shape[0]), levels]


def init(
    array: OrthogonalArray,
    lower: Float[np.ndarray, " parameter"],
    upper: Float[np.ndarray, " parameter"],
    initial_point: Float[np.ndarray, " parameter"] | None = None,
    config: SoatConfig | None = None,
) -> SoatState:
    """Begin a test of all cases of an array.

    Args:
        array: one factor per parameter.
        lower: lower bounds, in any unit (0 for the unit cube).
        upper: upper bounds, greater than the lower ones.
        initial_point: x_0, within the bounds; tested after the cases of the array. None: there is no such point.
        config: options; None means `SoatConfig()`.

    Raises:
        ValueError: bounds or initial point do not fit the array or one another.

    Source: Algorithm 1, lines 1-6; Eqs. 7-8.
    Deviation: all parameters have the same number of levels, as in the paper's studies though not in Eq. 7. The
        initial point is an extra case, because with an even number of levels it never is a level and would otherwise
        never be compared (not if literal).
    """
    config = SoatConfig() if config is None else config
    values = level_values(lower, upper, array.num_levels)
    if lower.shape[0] != array.num_factors:
        raise ValueError(f"Expected bounds of {array.num_factors} parameters for {array.name}; got {lower.shape[0]}.")
    candidates = points_from_levels(values, array.levels)
    if initial_point is not None and not config.literal:
        if initial_point.shape != lower.shape or not ((lower <= initial_point) & (initial_point <= upper)).all():
            raise ValueError(
                f"Expected an initial point of shape {lower.shape} within the bounds; got {initial_point}."
            )
        candidates = np.vstack([candidates, initial_point])
    return SoatState(
        config=config,
        array=array,
        level_values=values,
        candidates=candidates,
        accuracy=np.full(candidates.shape[0], FAILED_ACCURACY),
        num_told=0,
        status=SearchStatus.RUNNING,
    )


def ask(state: SoatState) -> Float[np.ndarray, "case parameter"]:
    """Return all cases not yet told, in order; none if the search is over."""
    if state.status.is_final:
        return state.candidates[:0].copy()
    return state.candidates[state.num_told :].copy()


def tell(
    state: SoatState, accuracy: Float[np.ndarray, " case"], is_ok: Bool[np.ndarray, " case"] | None = None
) -> tuple[SoatState, SoatInfo]:
    """Take the accuracy of the first cases of the last ask: all of them or a leading chunk.

    Args:
        state: of the last step.
        accuracy: one per case, at most 1; nan means failed.
        is_ok: what the simulator said about each case; None means that all went well.

    Raises:
        ValueError: more cases than were asked, or shapes that differ.

    Source: Algorithm 1, lines 7-20; Eq. 9.
    Deviation: all cases are evaluated, because range analysis needs the complete array (Algorithm 1 breaks at the
        threshold); the best accuracy starts at -inf, because Eq. 9 is negative as soon as the relative errors sum to
        more than 1 (Algorithm 1 starts at 0 and then returns nothing). With `literal` both are as printed, and cases
        of the chunk after the break are ignored. A failed case never is the best.
    """
    num_pending = ask(state).shape[0]
    if accuracy.ndim != 1 or accuracy.shape[0] > num_pending:
        raise ValueError(f"Expected the accuracy of at most {num_pending} cases; got shape {accuracy.shape}.")
    is_counted = is_successful(accuracy, is_ok)
    status = SearchStatus.RUNNING
    if state.config.literal:
        reached = np.flatnonzero(is_counted & (accuracy >= state.config.accuracy_threshold))
        if reached.size:
            status = SearchStatus.THRESHOLD_REACHED
            accuracy, is_counted = accuracy[: reached[0] + 1], is_counted[: reached[0] + 1]

    num_told = state.num_told + accuracy.shape[0]
    told = state.accuracy.copy()
    told[state.num_told : num_told] = np.where(is_counted, accuracy, FAILED_ACCURACY)
    if not status.is_final and num_told == state.candidates.shape[0]:
        status = SearchStatus.COMPLETE if np.isfinite(told).any() else SearchStatus.NOTHING_SUCCEEDED
    state = replace(state, accuracy=told, num_told=num_told, status=status)
    return state, summarise(state)


def summarise(state: SoatState) -> SoatInfo:
    """Return the best case so far and what happened to the others."""
    is_counted = np.isfinite(state.accuracy)
    accuracy = np.where(is_counted, state.accuracy, -np.inf)
    case = int(np.argmax(accuracy))
    floor = 0.0 if state.config.literal else -np.inf
    has_best = bool(accuracy[case] > floor)
    best_accuracy = float(accuracy[case]) if has_best else floor
    return SoatInfo(
        best_case=case if has_best else None,
        best_candidate=state.candidates[case].copy() if has_best else None,
        best_accuracy=best_accuracy,
        is_initial_point_best=has_best and case >= state.array.num_cases,
        is_threshold_reached=has_best and best_accuracy >= state.config.accuracy_threshold,
        num_told=state.num_told,
        num_failed=int(state.num_told - is_counted.sum()),
        status=state.status,
    )
