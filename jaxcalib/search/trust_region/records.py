"""Records of the trust-region search: its options, what the next step needs, and what a person wants to see."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.least_squares.response_surface import ResponseSurface
from jaxcalib.search.trust_region.evaluated_points import EvaluatedPoints


@dataclass(frozen=True)
class TrustRegionConfig:
    """Options of the trust-region search. Radii are in coordinates of the unit cube.

    Raises:
        ValueError: an option is out of its range.

    Source: Conn, Gould & Toint (2000), Trust-Region Methods, ch. 6; relaxed ratio: Sun & Nocedal (2023), A
        trust-region method for noisy unconstrained optimization.
    """

    num_iterations: int = 20  # most pairs of a design and a trial, >= 1
    initial_radius: float = 0.15  # between the least and the greatest radius
    least_radius: float = 0.005  # below it the search ends; > 0
    greatest_radius: float = 0.5  # at most 0.5
    design: Literal["central", "two_level"] = "central"  # "central" (2 M + 1 candidates) or "two_level" (about M + 1)
    # "linear", or "quadratic" in each parameter alone, for which "central" suffices
    surface: Literal["linear", "quadratic"] = "linear"
    ridge: float = 1e-4  # of the fit of the surface, relative, >= 0
    damping: float = 1e-3  # of the Levenberg-Marquardt step, relative, >= 0
    # earlier points up to so many radii from the centre (in each parameter) help to fit the surface
    reuse_radius: float = 2.0
    # shares of the step that are tried together; the best of them competes with the centre
    step_fractions: tuple[float, ...] = (1.0,)
    # how many standard deviations of noise are added to actual and predicted improvement before their ratio is
    # taken, >= 0
    noise_relaxation: float = 1.0
    # of the misfit; below it the search ends. With weights 1 / noise variance, 1 is what the noise of one measure
    # amounts to.
    least_predicted_improvement: float = 0.1
    acceptance_ratio: float = 0.1  # least ratio of actual to predicted improvement at which the centre moves
    shrink_ratio: float = 0.25  # below it the radius shrinks
    grow_ratio: float = 0.75  # above it the radius grows if the step reached the border of the region
    shrink_factor: float = 0.5  # in (0, 1)
    grow_factor: float = 2.0

    def __post_init__(self) -> None:
        """Check the options."""
        if not 0.0 < self.least_radius <= self.initial_radius <= self.greatest_radius <= 0.5:
            raise ValueError(
                f"Expected 0 < least_radius <= initial_radius <= greatest_radius <= 0.5; got {self.least_radius}, "
                f"{self.initial_radius}, {self.greatest_radius}."
            )
        if not 0.0 <= self.acceptance_ratio <= self.shrink_ratio <= self.grow_ratio:
            raise ValueError(
                f"Expected 0 <= acceptance_ratio <= shrink_ratio <= grow_ratio; got {self.acceptance_ratio}, "
                f"{self.shrink_ratio}, {self.grow_ratio}."
            )
        if not (0.0 < self.shrink_factor < 1.0 < self.grow_factor):
            raise ValueError(f"Expected shrink_factor < 1 < grow_factor; got {self.shrink_factor}, {self.grow_factor}.")
        if not self.step_fractions or not all(0.0 < share <= 1.0 for share in self.step_fractions):
            raise ValueError(f"Expected shares of the step in (0, 1]; got {self.step_fractions}.")
        for name in ("ridge", "damping", "noise_relaxation", "least_predicted_improvement", "num_iterations"):
            if getattr(self, name) < (1 if name == "num_iterations" else 0):
                raise ValueError(f"`{name}` is too small; got {getattr(self, name)}.")
        if self.reuse_radius < 2.0:
            raise ValueError(
                f"Expected reuse_radius >= 2 (a design at a bound reaches so far); got {self.reuse_radius}."
            )
        for name, choice, known in (
            ("design", self.design, ("central", "two_level")),
            ("surface", self.surface, ("linear", "quadratic")),
        ):
            if choice not in known:
                raise ValueError(f"Expected {name} among {known}; got {choice!r}.")


@dataclass(frozen=True)
class TrustRegionState:
    """What the next step needs."""

    config: TrustRegionConfig  # options
    iteration: int  # pairs of a design and a trial that are finished
    center: Float[np.ndarray, " parameter"]  # best point known, in the unit cube; the result of the search
    radius: float  # of the trust region, in each parameter
    candidates: Float[np.ndarray, "candidate parameter"]  # what is to be evaluated next
    # of each trial; None while a design is to be evaluated
    predicted_improvement: Float[np.ndarray, " candidate"] | None
    evaluated: EvaluatedPoints | None  # everything told so far; None at the beginning
    status: SearchStatus  # where the search stands


@dataclass(frozen=True)
class TrustRegionInfo:
    """What a person wants to see about the candidates just told."""

    iteration: int  # its number
    is_trial: bool  # whether they were trials
    is_accepted: bool  # whether the centre moved to a trial
    ratio: float  # of actual to predicted improvement, noise added to both; nan after a design or if all trials failed
    actual_improvement: float  # of the misfit, by the best trial; nan as above
    predicted_improvement: float  # by the best trial, or after a design by the full step
    center: Float[np.ndarray, " parameter"]  # best point known
    center_misfit: float  # its misfit; nan if it was never evaluated with success
    radius: float  # for the next design
    num_failed: int  # candidates that failed
    surface: ResponseSurface | None  # the response surface; None after a trial
    # Gauss-Newton precision of the parameters at the centre, prior included, in coordinates of the unit cube;
    # None after a trial
    precision: Float[np.ndarray, "parameter parameter"] | None
    status: SearchStatus  # where the search stands


def blank_info(state: TrustRegionState, is_counted: Bool[np.ndarray, " candidate"]) -> TrustRegionInfo:
    """Return what is known of a tell before anything is done with it."""
    return TrustRegionInfo(
        iteration=state.iteration,
        is_trial=False,
        is_accepted=False,
        ratio=np.nan,
        actual_improvement=np.nan,
        predicted_improvement=np.nan,
        center=state.center.copy(),
        center_misfit=np.nan,
        radius=state.radius,
        num_failed=int((~is_counted).sum()),
        surface=None,
        precision=None,
        status=state.status,
    )
