"""Adam from several starts (`optax`), on exact slopes where there are some, otherwise on finite differences.

Differences are between candidates that are evaluated together: where these share their random numbers, the noise in
them cancels.
"""

from dataclasses import dataclass, replace

import numpy as np
import optax
from jaxtyping import Float

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of

STEP_SIZE = 0.1  # of the unit range, at the beginning
DIFFERENCE = 0.03  # of the unit range
FEWEST_STEPS = 15  # of each start; with fewer, there are fewer starts


@dataclass(frozen=True)
class DescentState:
    """Where all starts stand."""

    setting: Setting  # as given
    points: Float[np.ndarray, "start parameter"]  # iterates
    adam: optax.OptState  # optax's state
    step: int = 0  # from 0


class GradientDescent(Optimiser):
    """Adam with a cosine decay; a start whose slopes fail moves to a random point."""

    def init(self, setting: Setting) -> DescentState:
        """Return the first state: the start and random ones."""
        cost = _cost(setting)
        num_starts = int(np.clip(setting.num_evaluations // (cost * FEWEST_STEPS), 1, setting.batch_size))
        random = generator(setting.seed, 0).random((num_starts - 1, setting.num_parameters))
        points = np.vstack([setting.start, random])
        return DescentState(setting, points, _adam(setting, num_starts).init(points))

    def ask(self, state: DescentState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the iterates, each followed by its neighbours where slopes are differences."""
        if state.setting.has_slopes:
            return state.points.copy()
        return np.clip(state.points[:, None] + _offsets(state.points), 0.0, 1.0).reshape(-1, state.points.shape[1])

    def tell(self, state: DescentState, told: Told) -> tuple[DescentState, RoundInfo]:
        """Return the state after a step of every start."""
        setting, (num_starts, num_parameters) = state.setting, state.points.shape
        if setting.has_slopes and told.slopes is not None:
            slopes = told.slopes
        else:
            misfit = np.sum(told.residuals**2, axis=1).reshape(num_starts, -1)
            steps = np.diagonal(_offsets(state.points)[:, 1:], axis1=1, axis2=2)
            slopes = (misfit[:, 1:] - misfit[:, :1]) / steps
        is_lost = np.asarray(~np.isfinite(slopes).any(axis=1))
        adam = _adam(setting, num_starts)
        # optax computes in single precision, so that the same steps come out with and without 64 bit switched on.
        update, next_adam = adam.update(np.nan_to_num(slopes).astype(np.float32), state.adam)
        points = np.clip(state.points + np.asarray(update, float), 0.0, 1.0)
        fresh = generator(setting.seed, state.step + 1).random((num_starts, num_parameters))
        points = np.where(is_lost[:, None], fresh, points)
        return replace(state, points=points, adam=next_adam, step=state.step + 1), info_of(told)


def _cost(setting: Setting) -> int:
    return 1 if setting.has_slopes else setting.num_parameters + 1


def _adam(setting: Setting, num_starts: int) -> optax.GradientTransformation:
    num_steps = max(1, setting.num_evaluations // (_cost(setting) * num_starts))
    return optax.adam(optax.cosine_decay_schedule(STEP_SIZE, num_steps))


def _offsets(points: Float[np.ndarray, "start parameter"]) -> Float[np.ndarray, "start neighbour parameter"]:
    """Return nothing, then one step along each parameter, away from the nearer bound."""
    directions = np.where(points > 0.5, -DIFFERENCE, DIFFERENCE)
    steps = directions[:, None] * np.eye(points.shape[1])
    return np.concatenate([np.zeros_like(steps[:, :1]), steps], axis=1)
