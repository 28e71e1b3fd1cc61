"""Tree-structured Parzen estimator: Optuna's, multivariate, built anew from all that was told before each batch."""

from dataclasses import dataclass, replace

import numpy as np
import optuna
from jaxtyping import Float
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.trial import TrialState, create_trial

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, info_of

optuna.logging.set_verbosity(optuna.logging.WARNING)


@dataclass(frozen=True)
class TpeState:
    """All that was told, and what is asked."""

    setting: Setting
    candidates: Float[np.ndarray, "candidate parameter"]
    told: Told | None = None
    num_batches: int = 1


class Tpe(Optimiser):
    """TPE in batches: running trials count as bad ones (the constant liar), so that a batch spreads."""

    def init(self, setting: Setting) -> TpeState:
        """Return the first state: the start, then what TPE begins with."""
        rest = _draw(setting, None, 0)[1:]
        return TpeState(setting, np.vstack([setting.start, rest]))

    def ask(self, state: TpeState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the batch."""
        return state.candidates.copy()

    def tell(self, state: TpeState, told: Told) -> tuple[TpeState, RoundInfo]:
        """Return the state with the next batch."""
        together = told.joined(state.told)
        candidates = _draw(state.setting, together, state.num_batches)
        state = replace(state, candidates=candidates, told=together, num_batches=state.num_batches + 1)
        return state, info_of(told)


def _draw(setting: Setting, told: Told | None, batch: int) -> Float[np.ndarray, "candidate parameter"]:
    seed = int(np.random.SeedSequence([setting.seed, batch]).generate_state(1)[0])
    sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    space: dict[str, BaseDistribution] = {
        f"x{place}": FloatDistribution(0.0, 1.0) for place in range(setting.num_parameters)
    }
    if told is not None:
        for point, accuracy in zip(told.points, told.accuracy, strict=True):
            parameters = dict(zip(space, point.tolist(), strict=True))
            if np.isfinite(accuracy):
                study.add_trial(create_trial(params=parameters, distributions=space, value=float(accuracy)))
            else:
                study.add_trial(create_trial(state=TrialState.FAIL, params=parameters, distributions=space))
    trials = [study.ask(space) for _ in range(setting.batch_size)]
    return np.asarray([[trial.params[name] for name in space] for trial in trials])
