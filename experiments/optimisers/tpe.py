"""Tree-structured Parzen estimator: Optuna's, multivariate, built anew from all that was told before each batch."""

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.trial import TrialState, create_trial

from experiments.optimisers.batches import BatchOptimiser, Candidates
from jaxcalib.search.optimiser import Setting, Told

optuna.logging.set_verbosity(optuna.logging.WARNING)


class Tpe(BatchOptimiser):
    """TPE in batches: running trials count as bad ones (the constant liar), so that a batch spreads."""

    def first(self, setting: Setting) -> Candidates:
        """Return the start, then what TPE begins with."""
        return np.vstack([setting.start, _draw(setting, None, 0)[1:]])

    def following(self, setting: Setting, told: Told, number: int) -> Candidates:
        """Return what TPE draws."""
        return _draw(setting, told, number)


def _draw(setting: Setting, told: Told | None, batch: int) -> Candidates:
    seed = int(np.random.SeedSequence([setting.seed, batch]).generate_state(1)[0])
    sampler = optuna.samplers.TPESampler(seed=seed, multivariate=True, constant_liar=True)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    space: dict[str, BaseDistribution] = {
        f"x{number}": FloatDistribution(0.0, 1.0) for number in range(setting.num_parameters)
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
