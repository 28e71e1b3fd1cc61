"""Bayesian optimisation: the package `bayesian-optimization`, a Gaussian process and expected improvement, in batches.

Its parameters are fitted once for a batch, of which each candidate takes the next as already evaluated with the mean
accuracy (the constant liar), so that the batch spreads.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
from bayes_opt import BayesianOptimization
from bayes_opt.acquisition import ConstantLiar, ExpectedImprovement
from jaxtyping import Float
from scipy.stats import qmc
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import Matern, WhiteKernel
from threadpoolctl import threadpool_limits

from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, generator, info_of

INITIAL_PER_PARAMETER = 2  # candidates of the first design
NUM_RANDOM, NUM_DESCENTS = 1_000, 1  # of the search for the greatest expected improvement
EXPLORATION = 0.01  # xi, in units of the accuracy's spread


@dataclass(frozen=True)
class BayesianState:
    """All that was told, and what is asked."""

    setting: Setting
    candidates: Float[np.ndarray, "candidate parameter"]
    told: Told | None = None
    num_batches: int = 1


class Bayesian(Optimiser):
    """A Gaussian process with noise on the successful candidates; failed ones count as the worst seen."""

    def init(self, setting: Setting) -> BayesianState:
        """Return the first state: the start and a Latin hypercube."""
        size = max(setting.batch_size, INITIAL_PER_PARAMETER * setting.num_parameters) - 1
        design = qmc.LatinHypercube(setting.num_parameters, rng=generator(setting.seed, 0)).random(size)
        return BayesianState(setting, np.vstack([setting.start, design]))

    def ask(self, state: BayesianState) -> Float[np.ndarray, "candidate parameter"]:
        """Return the batch."""
        return state.candidates.copy()

    def tell(self, state: BayesianState, told: Told) -> tuple[BayesianState, RoundInfo]:
        """Return the state with the next batch."""
        together = told.joined(state.told)
        setting = state.setting
        if together.is_ok.any():
            # The matrices are too small for several threads, which would only wait for each other.
            with warnings.catch_warnings(), threadpool_limits(1):
                warnings.simplefilter("ignore", ConvergenceWarning)  # a parameter at its bound
                candidates = _suggest(setting, together, state.num_batches)
        else:
            shape = (setting.batch_size, setting.num_parameters)
            candidates = generator(setting.seed, state.num_batches).random(shape)
        state = replace(state, candidates=candidates, told=together, num_batches=state.num_batches + 1)
        return state, info_of(told)


def _suggest(setting: Setting, told: Told, batch: int) -> Float[np.ndarray, "candidate parameter"]:
    seed = int(np.random.SeedSequence([setting.seed, batch]).generate_state(1)[0])
    random = np.random.RandomState(seed)  # the kind that the package takes
    names = [f"x{place:03d}" for place in range(setting.num_parameters)]
    # The package improves on the best value seen, which noise and failures must not set: accuracies are standardised
    # over the successful candidates, and what lies far below does not stretch the process.
    good = told.accuracy[told.is_ok]
    spread = max(float(np.std(good)), 1e-12)
    lowest = float(np.min(good))
    target = (np.where(told.is_ok, told.accuracy, lowest) - float(np.median(good))) / spread
    acquisition = ConstantLiar(ExpectedImprovement(xi=EXPLORATION), strategy="mean")
    search = BayesianOptimization(
        f=None,
        pbounds={name: (0.0, 1.0) for name in names},
        acquisition_function=acquisition,
        random_state=random,
        verbose=0,
        allow_duplicate_points=True,
    )
    kernel = Matern(0.5, (0.02, 20.0), nu=2.5) + WhiteKernel(1e-3, (1e-8, 1.0))
    search.set_gp_params(kernel=kernel, n_restarts_optimizer=0)
    for point, value in zip(told.points, target, strict=True):
        search.register(dict(zip(names, point.tolist(), strict=True)), float(value))
    candidates = []
    for number in range(setting.batch_size):
        point = acquisition.suggest(
            search._gp, search.space, n_random=NUM_RANDOM, n_smart=NUM_DESCENTS, random_state=random
        )
        candidates.append(point)
        if number == 0:
            search._gp.set_params(kernel=search._gp.kernel_, optimizer=None)
    return np.clip(np.stack(candidates), 0.0, 1.0)
