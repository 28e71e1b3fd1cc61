"""Both engines keep the same contract: the same question in, the same kind of answer out, in the same order."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunOutcome, RunRequest, Simulator, Status

pytestmark = pytest.mark.long

# The surrogate looks every 10 s whether runs are over, beginning 1 s before the first departure.
# Runs end while the subject vehicle is on its way, so that both engines count for as long.
END_S, DEPARTS_S = 180.0, (166.0, 161.0)
NUM_SEEDS = 6
FACTORS = (1.0, 0.7)  # of the scenario's demand


@pytest.fixture(scope="module")
def requests(small_problem: CalibrationProblem) -> list[RunRequest]:
    values = small_problem.template.base_values()
    demand, behaviour = np.split(values, [small_problem.layout.num_inputs])
    return [
        RunRequest((*(factor * demand).tolist(), *behaviour.tolist()), seed, depart_s)
        for seed in range(NUM_SEEDS)
        for factor, depart_s in zip(FACTORS, DEPARTS_S, strict=True)
    ]


@pytest.fixture(scope="module")
def surrogate(small_surrogate: Simulator) -> Simulator:
    return small_surrogate


@pytest.fixture(scope="module")
def sumo(small_problem: CalibrationProblem) -> Iterator[Simulator]:
    with sumo_engine(small_problem, num_processes=2) as simulator:
        yield simulator


@pytest.fixture(scope="module")
def outcomes_of_surrogate(surrogate: Simulator, requests: list[RunRequest]) -> list[RunOutcome]:
    """All requests, and the second one once more."""
    return surrogate.run([*requests, requests[1]])


@pytest.fixture(scope="module")
def outcomes_of_sumo(sumo: Simulator, requests: list[RunRequest]) -> list[RunOutcome]:
    return sumo.run([*requests, requests[1]])


@pytest.fixture(scope="module", params=["surrogate", "sumo"])
def engine(request: pytest.FixtureRequest) -> Simulator:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module", params=["surrogate", "sumo"])
def outcomes(request: pytest.FixtureRequest) -> list[RunOutcome]:
    return request.getfixturevalue(f"outcomes_of_{request.param}")


def test_the_layout_is_the_problem_s(engine: Simulator, small_problem: CalibrationProblem):
    assert engine.layout == small_problem.layout
    assert engine.layout.names[:3] == ("main", "on1", "tau")


def test_outcomes_come_in_the_order_of_the_requests(outcomes: list[RunOutcome], requests: list[RunRequest]):
    assert [outcome.request for outcome in outcomes] == [*requests, requests[1]]
    assert all(outcome.status is Status.OK for outcome in outcomes)


def test_the_observations_are_the_problem_s_tallies(outcomes: list[RunOutcome], small_problem: CalibrationProblem):
    for outcome in outcomes:
        assert isinstance(outcome.observed, np.ndarray)
        assert outcome.observed.shape == (len(small_problem.tally_names),)
        assert np.isfinite(outcome.observed).all()
        assert not outcome.subject_left  # the run ends before
        tally = dict(zip(small_problem.tally_names, outcome.observed, strict=True))
        assert tally["drives"] == 1
        # one frame every 0.5 s from the departure to the end; there is room within seconds
        assert 0 <= END_S - outcome.request.depart_s - tally["subject_time_s"] <= 5.0
        assert tally["subject_frames"] == pytest.approx(1 + 2 * tally["subject_time_s"], abs=0.01)


def test_the_same_request_gives_the_same_bits(outcomes: list[RunOutcome]):
    first, again = outcomes[1], outcomes[-1]
    np.testing.assert_array_equal(first.observed, again.observed)
    assert first.num_arrived.tolist() == again.num_arrived.tolist()
    assert not np.array_equal(first.observed, outcomes[3].observed)  # another seed


def test_arrivals_are_those_of_the_demand(outcomes: list[RunOutcome], requests: list[RunRequest]):
    """Arrivals are random: their number scatters by its square root, 2 % of the 1900 or so of all runs together."""
    made = outcomes[: len(requests)]
    arrived = np.sum([outcome.num_arrived for outcome in made], axis=0)
    expected = np.sum([outcome.request.values[:2] for outcome in made], axis=0) / 3600 * END_S
    assert expected.sum() > 1500
    assert np.all(np.abs(arrived - expected) <= 3 * np.sqrt(expected))
    for outcome in made:
        assert np.all(outcome.num_inserted <= outcome.num_arrived)
        assert 0.0 <= outcome.backlog_share < 0.1
        assert (outcome.num_collisions, outcome.num_teleports) == (0, 0)


def test_a_subject_vehicle_that_never_enters_is_missing(engine: Simulator, requests: list[RunRequest]):
    (outcome,) = engine.run([replace(requests[0], depart_s=END_S + 1.0)])
    assert outcome.status is Status.SUBJECT_MISSING
    assert outcome.observed is None


def test_both_count_alike(
    outcomes_of_surrogate: list[RunOutcome], outcomes_of_sumo: list[RunOutcome], small_problem: CalibrationProblem
):
    """Time and arrivals do not hang on how vehicles drive; the speed of free traffic does so but little."""
    names = (*small_problem.tally_names, "arrived")
    one, other = (
        dict(zip(names, np.sum([[*run.observed, run.num_arrived.sum()] for run in outcomes], axis=0), strict=True))
        for outcomes in (outcomes_of_surrogate, outcomes_of_sumo)
    )
    assert one["subject_time_s"] == pytest.approx(other["subject_time_s"], rel=0.02)
    assert one["arrived"] == pytest.approx(other["arrived"], rel=0.07)  # each scatters by 2 %
    speed = small_problem.measures["traffic_speed_mps"]
    assert speed.value(one).value == pytest.approx(speed.value(other).value, rel=0.1)
