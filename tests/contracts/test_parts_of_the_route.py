"""Both simulators are observed where the logs are, and there they show what they show anyway."""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunOutcome, RunRequest, Simulator, Status
from sim_adapters.sumo.simulator import SumoSimulator
from sim_adapters.world.recorded_parts import RecordedParts

pytestmark = pytest.mark.long

FIRST_M, LAST_M, TWO_M = ((-np.inf, 800.0),), ((800.0, np.inf),), ((600.0, 700.0), (850.0, 1000.0))
PARTS = (((-np.inf, np.inf),), FIRST_M, LAST_M, TWO_M)
BEYOND_M = ((5000.0, np.inf),)  # where nobody comes to
DEPART_S = 70.0
FRAME_M = 20.0  # farther than any vehicle drives from frame to frame


@pytest.fixture(scope="module", params=["surrogate", "sumo"])
def make(request: pytest.FixtureRequest) -> Callable[[CalibrationProblem], Simulator]:
    return surrogate_engine if request.param == "surrogate" else lambda problem: sumo_engine(problem, num_processes=1)


@pytest.fixture(scope="module")
def outcomes(
    small_problem: CalibrationProblem, make: Callable[[CalibrationProblem], Simulator]
) -> Iterator[list[RunOutcome]]:
    """One drive, observed in as many ways as there are logs."""
    parts = (*PARTS, BEYOND_M)
    template = dataclasses.replace(small_problem.template, recorded=tuple(map(RecordedParts, parts)))
    simulator = make(dataclasses.replace(small_problem, template=template))
    values = tuple(template.base_values().tolist())
    yield simulator.run([RunRequest(values, 3, DEPART_S, drive=drive) for drive in range(len(parts))])
    if isinstance(simulator, SumoSimulator):
        simulator.close()


@pytest.fixture(scope="module")
def of(small_problem: CalibrationProblem, outcomes: list[RunOutcome]) -> Callable[[str], np.ndarray]:
    return lambda name: np.asarray(
        [outcome.observed[small_problem.tally_index[name]] for outcome in outcomes[: len(PARTS)]]
    )


def test_a_part_is_as_long_as_it_is(of: Callable[[str], np.ndarray]):
    whole_m, first_m, last_m, two_m = of("subject_distance_m")
    assert first_m + last_m == pytest.approx(whole_m, abs=FRAME_M)
    assert 1060.0 - 800.0 - 2 * FRAME_M < last_m < 1070.0 - 800.0
    assert two_m == pytest.approx(400.0, abs=2 * FRAME_M)  # a drive goes on in a gap


def test_what_is_seen_in_two_halves_is_what_is_seen(of: Callable[[str], np.ndarray]):
    for name in ("subject_frames", "lane_m_frames"):
        whole, first, last, two = of(name)
        assert first + last == pytest.approx(whole, rel=1e-6)
        assert 0.3 * whole < two < 0.8 * whole


def test_a_run_that_never_comes_to_its_part_fails(outcomes: list[RunOutcome]):
    assert [outcome.status for outcome in outcomes] == [*[Status.OK] * len(PARTS), Status.UNSEEN]
    assert outcomes[-1].observed is None
    assert not outcomes[-1].status.is_ok


def test_a_drive_is_one_however_many_parts_it_has(of: Callable[[str], np.ndarray]):
    np.testing.assert_array_equal(of("drives"), 1.0)
