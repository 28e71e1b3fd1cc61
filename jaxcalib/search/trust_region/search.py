"""Local search for noisy, smooth residual vectors: Gauss-Newton on a response surface, as init / ask / tell.

    state = trust_region.init(center)
    while not state.status.is_final:
        state, info = trust_region.tell(state, residuals_of(trust_region.ask(state)), weights, prior=prior)

Asks alternate: a design around the centre, from which a response surface is fitted, and a trial, the step that
minimises the misfit on that surface. The misfit is the weighted sum of squared residuals, plus that of the prior.
Weights are 1 / noise variance, so they also say how much of an improvement may be noise; give large weights to exact
residuals. There are no random numbers.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.least_squares.response_surface import fit_response_surface
from jaxcalib.search.least_squares.surface_step import GaussianPrior, levenberg_marquardt_step, predicted_misfit
from jaxcalib.search.trust_region.evaluated_points import (
    EvaluatedPoints,
    append_points,
    compare_points,
    is_evaluated,
    measure_weights,
    misfit_at,
)
from jaxcalib.search.trust_region.local_design import local_design
from jaxcalib.search.trust_region.records import TrustRegionConfig, TrustRegionInfo, TrustRegionState, blank_info


def init(
    center: Float[np.ndarray, " parameter"],
    config: TrustRegionConfig | None = None,
    known: EvaluatedPoints | None = None,
) -> TrustRegionState:
    """Begin a search around a point.

    Args:
        center: in the unit cube, for example the best candidate of the genetic algorithm.
        config: options; None means `TrustRegionConfig()`.
        known: points that have been evaluated before; those near the centre help to fit the surface.

    Raises:
        ValueError: the centre is not a point of the unit cube.

    Source: not in the paper, whose last phase is Algorithm 3.
    """
    config = TrustRegionConfig() if config is None else config
    if center.ndim != 1 or center.size == 0 or not ((center >= 0.0) & (center <= 1.0)).all():
        raise ValueError(f"Expected a point of the unit cube; got {center}.")
    return TrustRegionState(
        config=config,
        iteration=0,
        center=center.copy(),
        radius=config.initial_radius,
        candidates=local_design(center, config.initial_radius, config.design, 0),
        predicted_improvement=None,
        evaluated=known,
        status=SearchStatus.RUNNING,
    )


def ask(state: TrustRegionState) -> Float[np.ndarray, "candidate parameter"]:
    """Return the candidates that are to be evaluated; none if the search is over."""
    return state.candidates[:0].copy() if state.status.is_final else state.candidates.copy()


def tell(
    state: TrustRegionState,
    residuals: Float[np.ndarray, "candidate measure"],
    weights: Float[np.ndarray, "..."],
    *,
    is_ok: Bool[np.ndarray, " candidate"] | None = None,
    prior: GaussianPrior | None = None,
) -> tuple[TrustRegionState, TrustRegionInfo]:
    """Take the residual vectors of the candidates asked for.

    Args:
        state: of the last step.
        residuals: simulated minus field value of each measure. A candidate with a residual that is not finite has
            failed and is dropped, unless the weight of that residual is 0.
        weights: 1 / noise variance of each residual, finite and >= 0, per measure [measure] or [candidate, measure];
            0 leaves the residual out.
        is_ok: what the simulator said about each candidate; None means that all went well.
        prior: on the parameters, the same in every tell of a search.

    Raises:
        ValueError: shapes that do not fit, or weights that are negative or not finite.

    Source: Conn, Gould & Toint (2000), Trust-Region Methods, ch. 6.
    Deviation: noise is added to actual and predicted improvement before their ratio is taken (Sun & Nocedal 2023), so
        that the radius does not shrink only because the improvement is less than the noise.
    """
    candidates = ask(state)
    if residuals.ndim != 2 or residuals.shape[0] != candidates.shape[0]:
        raise ValueError(f"Expected residuals of {candidates.shape[0]} candidates; got shape {residuals.shape}.")
    if weights.shape not in (residuals.shape, residuals.shape[1:]):
        raise ValueError(f"Expected weights of shape {residuals.shape[1:]} or {residuals.shape}; got {weights.shape}.")
    weights = np.broadcast_to(weights, residuals.shape)
    if not (np.isfinite(weights) & (weights >= 0.0)).all():
        raise ValueError("Expected finite weights >= 0.")
    is_counted = (np.isfinite(residuals) | (weights == 0.0)).all(axis=1) & (weights > 0.0).any(axis=1)
    if is_ok is not None:
        if is_ok.shape != is_counted.shape:
            raise ValueError(f"Expected `is_ok` of shape {is_counted.shape}; got {is_ok.shape}.")
        is_counted &= is_ok
    evaluated = append_points(state.evaluated, candidates, residuals, weights, is_counted)
    state = replace(state, evaluated=evaluated)
    if state.predicted_improvement is None:
        return _after_design(state, evaluated, is_counted, prior)
    return _after_trial(state, evaluated, is_counted, state.predicted_improvement, prior)


def _after_design(
    state: TrustRegionState,
    evaluated: EvaluatedPoints,
    is_counted: Bool[np.ndarray, " candidate"],
    prior: GaussianPrior | None,
) -> tuple[TrustRegionState, TrustRegionInfo]:
    """Fit the response surface and propose trials."""
    config, info = state.config, blank_info(state, is_counted)
    if evaluated.points.shape[0] == 0:
        return _finish_iteration(
            replace(state, radius=state.radius * config.shrink_factor, status=SearchStatus.RESAMPLED), info, prior
        )
    if not is_evaluated(evaluated, state.center):
        misfits = [misfit_at(evaluated, point, prior) for point in evaluated.points]
        state = replace(state, center=evaluated.points[int(np.argmin(misfits))].copy())
    # A hair more than the reuse radius: a design moved inwards at a bound lies at two radii up to rounding.
    is_near = np.abs(evaluated.points - state.center).max(axis=1) <= config.reuse_radius * state.radius * (1.0 + 1e-9)
    surface = fit_response_surface(
        evaluated.points[is_near],
        evaluated.residuals[is_near],
        evaluated.weights[is_near],
        state.center,
        state.radius,
        is_quadratic=config.surface == "quadratic",
        ridge=config.ridge,
    )
    weights = measure_weights(evaluated)
    step = levenberg_marquardt_step(surface, weights, prior, config.damping)
    shares = np.array(config.step_fractions)
    trials = np.clip(state.center + shares[:, None] * (step.candidate - state.center), 0.0, 1.0)
    at_center = predicted_misfit(surface, np.zeros_like(step.step), weights, prior)
    predicted = at_center - np.array([predicted_misfit(surface, share * step.step, weights, prior) for share in shares])
    is_converged = step.predicted_improvement < config.least_predicted_improvement
    state = replace(
        state,
        candidates=trials,
        predicted_improvement=np.maximum(predicted, 0.0),
        status=SearchStatus.CONVERGED if is_converged else SearchStatus.RUNNING,
    )
    precision = (surface.slope.T * weights) @ surface.slope / state.radius**2
    return state, replace(
        info,
        predicted_improvement=step.predicted_improvement,
        center=state.center.copy(),
        center_misfit=misfit_at(evaluated, state.center, prior),
        surface=surface,
        precision=precision if prior is None else precision + prior.precision,
        status=state.status,
    )


def _after_trial(
    state: TrustRegionState,
    evaluated: EvaluatedPoints,
    is_counted: Bool[np.ndarray, " candidate"],
    predicted_improvement: Float[np.ndarray, " candidate"],
    prior: GaussianPrior | None,
) -> tuple[TrustRegionState, TrustRegionInfo]:
    """Move the centre to the best trial or stay, and adapt the radius."""
    config, info = state.config, replace(blank_info(state, is_counted), is_trial=True)
    trials = np.flatnonzero(is_counted)
    comparisons = [compare_points(evaluated, state.center, state.candidates[trial], prior) for trial in trials]
    ratio = -np.inf  # if all trials failed
    if comparisons:
        best = int(np.argmax([comparison.improvement for comparison in comparisons]))
        noise = config.noise_relaxation * comparisons[best].standard_deviation
        predicted = float(predicted_improvement[trials[best]])
        ratio = (comparisons[best].improvement + noise) / (predicted + noise)
        trial = state.candidates[trials[best]]
        reach = float(np.abs(trial - state.center).max()) / state.radius
        info = replace(
            info,
            ratio=ratio,
            actual_improvement=comparisons[best].improvement,
            predicted_improvement=predicted,
            is_accepted=ratio > config.acceptance_ratio,
        )
        if ratio > config.grow_ratio and reach > 0.9:
            state = replace(state, radius=min(state.radius * config.grow_factor, config.greatest_radius))
        if info.is_accepted:
            state = replace(state, center=trial.copy())
    if ratio < config.shrink_ratio:
        state = replace(state, radius=state.radius * config.shrink_factor)
    return _finish_iteration(replace(state, status=SearchStatus.RUNNING), info, prior)


def _finish_iteration(
    state: TrustRegionState, info: TrustRegionInfo, prior: GaussianPrior | None
) -> tuple[TrustRegionState, TrustRegionInfo]:
    """Prepare the next design, or end the search."""
    config, evaluated = state.config, state.evaluated
    iteration, status = state.iteration + 1, state.status
    has_point = evaluated is not None and evaluated.points.shape[0] > 0
    if state.radius < config.least_radius:
        status = SearchStatus.CONVERGED if has_point else SearchStatus.NOTHING_SUCCEEDED
    elif iteration >= config.num_iterations:
        status = SearchStatus.COMPLETE if has_point else SearchStatus.NOTHING_SUCCEEDED
    radius = max(state.radius, config.least_radius)
    state = replace(
        state,
        iteration=iteration,
        radius=radius,
        candidates=local_design(state.center, radius, config.design, iteration),
        predicted_improvement=None,
        status=status,
    )
    is_known = evaluated is not None and is_evaluated(evaluated, state.center)
    return state, replace(
        info,
        center=state.center.copy(),
        center_misfit=misfit_at(evaluated, state.center, prior) if evaluated is not None and is_known else np.nan,
        radius=radius,
        status=status,
    )
