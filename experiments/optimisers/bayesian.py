"""Bayesian optimisation: the package `bayesian-optimization`, a Gaussian process and expected improvement, in batches.

Its parameters are fitted once for a batch, of which each candidate takes the next as already evaluated with the mean
accuracy (the constant liar), so that the batch spreads.
"""

import warnings

import numpy as np
from bayes_opt import BayesianOptimization
from bayes_opt.acquisition import ConstantLiar, ExpectedImprovement
from scipy.stats import qmc
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process.kernels import Matern, WhiteKernel
from threadpoolctl import threadpool_limits

from experiments.optimisers.batches import BatchOptimiser, Candidates
from jaxcalib.search.optimiser import Setting, Told, generator

INITIAL_PER_PARAMETER = 2  # candidates of the first design
NUM_RANDOM, NUM_DESCENTS = 1_000, 1  # of the search for the greatest expected improvement
EXPLORATION = 0.01  # xi, in units of the accuracy's spread


class Bayesian(BatchOptimiser):
    """A Gaussian process with noise on the successful candidates; failed ones count as the worst seen."""

    def first(self, setting: Setting) -> Candidates:
        """Return the start and a Latin hypercube."""
        size = max(setting.batch_size, INITIAL_PER_PARAMETER * setting.num_parameters) - 1
        design = qmc.LatinHypercube(setting.num_parameters, rng=generator(setting.seed, 0)).random(size)
        return np.vstack([setting.start, design])

    def following(self, setting: Setting, told: Told, number: int) -> Candidates:
        """Return candidates of great expected improvement."""
        if not told.is_ok.any():
            return generator(setting.seed, number).random((setting.batch_size, setting.num_parameters))
        # The matrices are too small for several threads, which would only wait for each other.
        with warnings.catch_warnings(), threadpool_limits(1):
            warnings.simplefilter("ignore", ConvergenceWarning)  # a parameter at its bound
            return _suggest(setting, told, number)


def _suggest(setting: Setting, told: Told, batch: int) -> Candidates:
    seed = int(np.random.SeedSequence([setting.seed, batch]).generate_state(1)[0])
    random = np.random.RandomState(seed)  # the kind that the package takes
    names = [f"x{number:03d}" for number in range(setting.num_parameters)]
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
