"""Functions whose optimum is known, as sums of squared residuals on the unit cube, with noise and with failures.

Source: sphere, Rosenbrock (1960), Rastrigin (1974) and Ackley (1987) in their usual forms. Rastrigin's is a sum of
    squares by 10 (1 - cos 2 pi z) = 20 sin^2 pi z; Ackley's is not, so its value is the only residual.
Deviation: the optimum lies where the seed says, not in the middle.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from jaxcalib.search.optimiser import Told, generator

Points = Float[np.ndarray, "candidate parameter"]
Residuals = Float[np.ndarray, "candidate residual"]
Jacobian = Float[np.ndarray, "candidate residual parameter"]

NOISE = {"exact": 0.0, "noisy": 0.05, "failing": 0.0}  # standard deviation of a residual over its typical size
RESOLUTION = 1e-4  # of the typical size: what counts as noise where there is none
FAILING_BEYOND = 0.15  # from the optimum along the first parameter, upwards
FAILING_SHARE = 0.05  # of the other candidates
PROBLEM = 1_000_000  # of random numbers: no optimiser draws the same, whatever its seed


def sphere(z: Points) -> tuple[Residuals, Jacobian]:
    """Return z and its slopes."""
    return z.copy(), np.tile(np.eye(z.shape[1]), (len(z), 1, 1))


def rosenbrock(z: Points) -> tuple[Residuals, Jacobian]:
    """Return 10 (z_i+1 - z_i^2) and 1 - z_i, and their slopes; the optimum is moved from 1 to 0."""
    z = z + 1.0
    number = z.shape[1] - 1
    residuals = np.hstack([10.0 * (z[:, 1:] - z[:, :-1] ** 2), 1.0 - z[:, :-1]])
    jacobian = np.zeros((len(z), 2 * number, z.shape[1]))
    places = np.arange(number)
    jacobian[:, places, places] = -20.0 * z[:, :-1]
    jacobian[:, places, places + 1] = 10.0
    jacobian[:, number + places, places] = -1.0
    return residuals, jacobian


def rastrigin(z: Points) -> tuple[Residuals, Jacobian]:
    """Return z and sqrt(20) sin(pi z), and their slopes."""
    eye = np.eye(z.shape[1])
    waves, slopes = np.sqrt(20.0) * np.sin(np.pi * z), np.sqrt(20.0) * np.pi * np.cos(np.pi * z)
    return np.hstack([z, waves]), np.concatenate([np.tile(eye, (len(z), 1, 1)), slopes[:, :, None] * eye], axis=1)


def ackley(z: Points) -> tuple[Residuals, Jacobian]:
    """Return Ackley's function as one residual, and its slopes, which are none at the optimum."""
    radius = np.sqrt(np.mean(z**2, axis=1, keepdims=True))
    bowl = 20.0 * np.exp(-0.2 * radius)
    waves = np.exp(np.mean(np.cos(2.0 * np.pi * z), axis=1, keepdims=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = np.where(radius > 0.0, z / radius, 0.0)
    slopes = (0.2 * bowl * towards + waves * 2.0 * np.pi * np.sin(2.0 * np.pi * z)) / z.shape[1]
    return 20.0 + np.e - bowl - waves, slopes[:, None, :]


FUNCTIONS: dict[str, tuple[Callable[[Points], tuple[Residuals, Jacobian]], float]] = {
    "sphere": (sphere, 1.0),
    "rosenbrock": (rosenbrock, 4.0),
    "rastrigin": (rastrigin, 10.0),
    "ackley": (ackley, 20.0),
}  # with the side of the cube


@dataclass(frozen=True)
class FunctionProblem:
    """One function, with its optimum where a seed says."""

    function: str  # its name
    variant: str  # "exact", "noisy" or "failing"
    num_parameters: int  # dimensions
    seed: int  # of optimum, start, noise and failures

    @property
    def name(self) -> str:
        """Name of the problem, without the seed."""
        return f"{self.function}_{self.variant}"

    @property
    def has_slopes(self) -> bool:
        """Whether evaluations come with exact slopes."""
        return True

    @property
    def optimum(self) -> Float[np.ndarray, " parameter"]:
        """The best point."""
        return generator(self.seed, PROBLEM, 1).uniform(0.3, 0.7, self.num_parameters)

    @property
    def start(self) -> Float[np.ndarray, " parameter"]:
        """Where every optimiser begins; it does not fail."""
        start = generator(self.seed, PROBLEM, 2).random(self.num_parameters)
        start[0] = min(start[0], self.optimum[0])
        return start

    @functools.cached_property
    def typical(self) -> float:
        """Root mean square residual over the cube."""
        points = qmc.Sobol(self.num_parameters, rng=generator(0)).random(1024)
        return float(np.sqrt(np.mean(self._residuals(points)[0] ** 2)))

    def evaluate(self, points: Points, first: int) -> Told:
        """Return what becomes of candidates of the unit cube; noise and failures differ by their numbers in the run."""
        residuals, jacobian = self._residuals(points)
        number = residuals.shape[1]
        draws = [generator(self.seed, PROBLEM, 3, first + number) for number in range(len(points))]
        crashes = np.asarray([draw.random() for draw in draws]) < FAILING_SHARE
        noise = self.typical * NOISE[self.variant]
        residuals = residuals + noise * np.asarray([draw.standard_normal(number) for draw in draws])
        unit = self.typical * max(NOISE[self.variant], RESOLUTION)
        accuracy = 1.0 - np.sqrt(np.mean(residuals**2, axis=1)) / self.typical
        slopes = 2.0 * np.einsum("crp,cr->cp", jacobian, residuals) / unit**2
        if self.variant == "failing":
            has_failed = (points[:, 0] > self.optimum[0] + FAILING_BEYOND) | crashes
            accuracy = np.where(has_failed, np.nan, accuracy)
            residuals = np.where(has_failed[:, None], np.nan, residuals)
            slopes = np.where(has_failed[:, None], np.nan, slopes)
        return Told(points, accuracy, residuals / unit, slopes)

    def measure(self, points: Points) -> dict[str, Float[np.ndarray, " candidate"]]:
        """Return the distance of points from the optimum without noise: root mean square residual over the typical."""
        return {"error": np.sqrt(np.mean(self._residuals(points)[0] ** 2, axis=1)) / self.typical}

    def _residuals(self, points: Points) -> tuple[Residuals, Jacobian]:
        function, side = FUNCTIONS[self.function]
        residuals, jacobian = function(side * (points - self.optimum))
        return residuals, side * jacobian
