"""A problem small enough to know its answer: three moments that answer linearly to two parameters, with noise."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.calibration.objective.evidence import Evidence, independent_evidence
from jaxcalib.calibration.objective.moments import Moments
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.measures.measure import Level
from jaxcalib.problem.parameter_space import ParameterSpace, Range
from sim_adapters.interface import DriveStart, ParameterLayout, RunOutcome, RunRequest, Status

LAYOUT = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "minGap"))
SPACE = ParameterSpace(LAYOUT, (Range(1000.0, 2000.0), Range(0.4, 3.0, True), Range(0.5, 6.0, True)))
TRUTH = np.asarray([0.37, 0.62, 0.21])  # in the unit cube
RESPONSE = np.asarray([[2.0, 0.3, -0.4], [0.2, 1.5, 0.5], [-0.3, 0.4, 1.2], [0.8, -0.6, 0.7]])
OFFSET = np.asarray([5.0, 9.0, 4.0, 7.0])
NOISE = np.asarray([0.3, 0.2, 0.25, 0.4])
COUNT = 100.0


class ToySimulator:
    """Draws tallies: for each moment a sum and a count."""

    def __init__(self, failing: tuple[float, float] | None = None, shift: np.ndarray | float = 0.0) -> None:
        """Fail wherever the second parameter lies in an interval of the unit range; else drive as with shifted ones."""
        self.failing, self.shift = failing, shift
        self.requests: list[RunRequest] = []

    @property
    def layout(self) -> ParameterLayout:
        return LAYOUT

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        self.requests += requests
        return [self._outcome(request) for request in requests]

    def _outcome(self, request: RunRequest) -> RunOutcome:
        unit = SPACE.unit_of(np.asarray(request.values))
        fails = self.failing is not None and self.failing[0] <= unit[1] <= self.failing[1]
        observed = None if fails else tallies(unit + self.shift, request.seed)
        none = np.zeros(1, int)
        status = Status.COLLIDED if fails else Status.OK
        return RunOutcome(request, status, observed, none, none, 0)


def tallies(unit: np.ndarray, seed: int) -> np.ndarray:
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(OFFSET))
    return np.concatenate([COUNT * (OFFSET + RESPONSE @ unit + noise), np.full(len(OFFSET), COUNT), [1.0]])


def starts_at(*departs_s: float) -> tuple[DriveStart, ...]:
    """Return drives that nothing but their departures tells apart."""
    return tuple(map(DriveStart, departs_s))


def toy_moments() -> Moments:
    places = np.arange(len(OFFSET))
    levels = (Level.TRAFFIC, Level.VEHICLE, Level.VEHICLE, Level.TRAFFIC)
    return Moments(("a", "b", "c", "d"), levels, places, places + 4, np.ones(4), 8)


def toy_objective(evidence: Evidence | None = None, num_drives: int = 8) -> Objective:
    field = np.mean([tallies(TRUTH, 900 + drive) for drive in range(num_drives)], axis=0)
    silent = independent_evidence(np.full(3, 0.5), np.full(3, np.inf))
    moments, covariance = toy_moments(), np.diag(NOISE**2)
    return Objective(moments, moments.values(field), covariance, OFFSET, num_drives, evidence or silent)


def toy_run(simulator: ToySimulator | None = None, objective: Objective | None = None) -> SearchRun:
    evaluator = Evaluator(simulator or ToySimulator(), starts_at(300.0, 320.0), 50)
    return SearchRun(evaluator, SPACE, objective or toy_objective())
