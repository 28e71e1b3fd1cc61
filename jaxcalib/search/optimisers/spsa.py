"""Simultaneous perturbation: slopes along random directions, averaged over what fits in a batch.

No library that is kept up asks and tells with it, and it is short.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of

STEP_DECAY, PERTURBATION_DECAY = 0.602, 0.101  # alpha and gamma
PERTURBATION = 0.05  # c, of the unit range
FIRST_STEP = 0.1  # of the unit range: the gain is chosen so
STABILITY_SHARE = 0.1  # A, of the iterations


@dataclass(frozen=True)
class SpsaState:
    """Where SPSA stands."""

    setting: Setting  # as given
    point: Float[np.ndarray, " parameter"]  # the iterate
    iteration: int = 0  # from 0
    gain: float | None = None  # a; None before the first slope is known
    # last iterate that did not fail; None before there is one
    last_success: Float[np.ndarray, " parameter"] | None = None


class Spsa(Optimiser):
    """SPSA with averaged slopes and a gain from the first of them.

    Source: Spall (1998), Implementation of the simultaneous perturbation algorithm for stochastic optimization, IEEE
        Trans. Aerosp. Electron. Syst. 34(3), Eqs. 2-4 and Section III (gains).
    Deviation: the iterate is evaluated, too, as the best candidate seen is the result. A direction of
        which one end failed counts from the iterate to the other end; an iterate that failed goes halfway back.
    """

    def init(self, setting: Setting) -> SpsaState:
        """Return the first state."""
        return SpsaState(setting, _inside(setting.start, PERTURBATION))

    def ask(self, state: SpsaState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the iterate, and both ends of each direction."""
        steps = self._perturbation(state) * _directions(state)
        return np.clip(np.vstack([state.point, state.point + steps, state.point - steps]), 0.0, 1.0)

    def tell(self, state: SpsaState, told: Told) -> tuple[SpsaState, RoundInfo]:
        """Return the state after a step down the averaged slope."""
        return self._moved(state, told), info_of(told)

    def _moved(self, state: SpsaState, told: Told) -> SpsaState:
        setting, directions = state.setting, _directions(state)
        following = replace(state, iteration=state.iteration + 1)
        here = float(told.accuracy[0])
        if np.isnan(here):
            if state.last_success is None:  # nothing is known; elsewhere it may go better
                back = generator(setting.seed, state.iteration, 1).random(setting.num_parameters)
            else:
                back = 0.5 * (state.point + state.last_success)
            return replace(following, point=_inside(back, self._perturbation(following)))
        following = replace(following, last_success=state.point)
        ahead, behind = told.accuracy[1:].reshape(2, -1)
        is_counted = np.isfinite(ahead) | np.isfinite(behind)
        if not is_counted.any():
            return following  # other directions from the same point
        num_ends = np.isfinite(ahead).astype(float) + np.isfinite(behind)
        rise = np.where(np.isfinite(ahead), ahead, here) - np.where(np.isfinite(behind), behind, here)
        difference = -rise[is_counted] / (num_ends[is_counted] * self._perturbation(state))
        slope = (difference[:, None] * directions[is_counted]).mean(axis=0)
        iterations = max(1, setting.num_evaluations // (1 + 2 * len(directions)))
        stability = STABILITY_SHARE * iterations
        gain = state.gain
        if gain is None:
            size = float(np.abs(slope).mean())
            if size == 0.0:
                return following
            gain = FIRST_STEP * (stability + 1.0) ** STEP_DECAY / size
        step = gain / (state.iteration + 1.0 + stability) ** STEP_DECAY * slope
        longest = float(np.abs(step).max())
        step *= min(1.0, 2.0 * FIRST_STEP / longest) if longest > 0.0 else 1.0
        return replace(following, point=_inside(state.point - step, self._perturbation(following)), gain=gain)

    @staticmethod
    def _perturbation(state: SpsaState) -> float:
        return PERTURBATION / (state.iteration + 1.0) ** PERTURBATION_DECAY


def _directions(state: SpsaState) -> Float[np.ndarray, "direction parameter"]:
    setting = state.setting
    shape = (max(1, (setting.batch_size - 1) // 2), setting.num_parameters)
    return generator(setting.seed, state.iteration).choice([-1.0, 1.0], size=shape)


def _inside(point: Float[np.ndarray, " parameter"], perturbation: float) -> Float[np.ndarray, " parameter"]:
    return np.clip(point, perturbation, 1.0 - perturbation)
