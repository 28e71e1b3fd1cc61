"""Whole runs of the corridor through the engine."""

from collections.abc import Sequence

import jax
import numpy as np
import pytest

from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.jax import simulator as jax_simulator
from sim_adapters.jax.simulator import JaxSimulator, usual_runs_per_device
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.loop.world import Clock
from tests.sim_adapters.jax.frame_trace import COLUMN, END_S, corridor_engine

pytestmark = pytest.mark.long

DEPART_S = 211.0  # so that runs end at `END_S` exactly: a decision earlier and then whole blocks of 10 s


@pytest.fixture(scope="module")
def requests(template: WorldTemplate) -> dict[str, RunRequest]:
    def request(seed: int, depart_s: float = DEPART_S, **changes: float) -> RunRequest:
        values = dict(zip(template.layout.names, template.base_values(), strict=True)) | {"main": 3400.0}
        assert not set(changes) - set(values)
        return RunRequest(tuple((values | changes).values()), seed, depart_s)

    return {
        "base": request(7),
        "lazy": request(7, tau=1.8, accel=1.3, speedFactor=0.91),
        "sparse": request(7, main=1500.0),
        "other seed": request(8),
        "later": request(7, depart_s=231.0),
        "ends later": request(7, depart_s=234.0),
        "never": request(7, depart_s=END_S + 41.0),
    }


@pytest.fixture(scope="module")
def outcomes(simulator: JaxSimulator, requests: dict[str, RunRequest]) -> dict[str, RunOutcome]:
    made = simulator.run([requests[name] for name in ("base", "lazy", "sparse")])
    made += simulator.run([requests["other seed"]])
    return dict(zip(("base", "lazy", "sparse", "other seed"), made, strict=True))


def told(outcome: RunOutcome) -> dict[str, float]:
    rows = outcome.observed[outcome.observed[:, COLUMN["time"]] > 0.0]
    sums = {name: float(rows[:, COLUMN[name]].sum()) for name in ("speed", "objects", "speeds")}
    smallest_m = rows[:, COLUMN["smallest_gap"]].min()
    return sums | {"frames": len(rows), "first_s": rows[0, 0], "last_s": rows[-1, 0], "smallest_gap": smallest_m}


def assert_same_bits(one: RunOutcome, other: RunOutcome) -> None:
    assert one.status is other.status
    assert one.observed.tobytes() == other.observed.tobytes()
    assert one.num_arrived.tolist() == other.num_arrived.tolist()
    assert one.num_inserted.tolist() == other.num_inserted.tolist()
    assert one.num_collisions == other.num_collisions


def test_runs_end_well_without_overlaps(outcomes: dict[str, RunOutcome]) -> None:
    for outcome in outcomes.values():
        assert outcome.status is Status.OK
        assert outcome.num_collisions == 0
        assert 0.0 <= told(outcome)["smallest_gap"] < 25.0


def test_frames_cover_the_drive_every_half_second(outcomes: dict[str, RunOutcome]) -> None:
    for outcome in outcomes.values():
        diary = told(outcome)
        assert DEPART_S < diary["first_s"] <= DEPART_S + 5.0
        assert diary["last_s"] == pytest.approx(END_S, abs=0.5)
        assert diary["frames"] == 1 + round((diary["last_s"] - diary["first_s"]) / 0.5)
        assert diary["objects"] > 3 * diary["frames"]  # it is not alone
        assert 5.0 < diary["speed"] / diary["frames"] <= 20.0 + 1e-3  # its vType's maxSpeed


def test_steps_as_long_as_frames(template: WorldTemplate, requests: dict[str, RunRequest]) -> None:
    """They leave no step between a frame and a decision; the road is long enough for several tiles."""
    coarse = corridor_engine(template, Clock(0.5, 2), capacity=480, runs_per_device=1)
    (outcome,) = coarse.run([requests["base"]])
    diary = told(outcome)
    assert outcome.status is Status.OK
    assert diary["frames"] == 1 + round((diary["last_s"] - diary["first_s"]) / 0.5)
    assert 5.0 < diary["speed"] / diary["frames"] <= 20.0 + 1e-3


def test_nobody_enters_who_has_not_arrived(outcomes: dict[str, RunOutcome]) -> None:
    for outcome in outcomes.values():
        assert (outcome.num_inserted <= outcome.num_arrived).all()
        assert (outcome.num_inserted > 0).all()
        assert outcome.backlog_share == pytest.approx(1.0 - outcome.num_inserted.sum() / outcome.num_arrived.sum())
    expected = END_S / 3600.0 * np.asarray([3400.0, 520.0])
    assert (np.abs(outcomes["base"].num_arrived - expected) < 4.0 * np.sqrt(expected)).all()


def test_outcomes_come_back_in_the_order_of_the_requests(
    simulator: JaxSimulator, requests: dict[str, RunRequest]
) -> None:
    asked = [requests[name] for name in ("later", "base", "lazy", "later", "sparse", "base")]  # two batches
    made = simulator.run(asked)
    assert [outcome.request for outcome in made] == asked
    assert_same_bits(made[0], made[3])
    assert_same_bits(made[1], made[5])


@pytest.mark.parametrize("companions", [(), ("sparse",), ("other seed", "lazy"), ("base", "base")])
def test_a_request_gives_the_same_bits_alone_and_beside_others(
    simulator: JaxSimulator,
    requests: dict[str, RunRequest],
    outcomes: dict[str, RunOutcome],
    companions: Sequence[str],
) -> None:
    others = [requests[name] for name in companions]
    for place in range(len(others) + 1):
        asked = [*others[:place], requests["base"], *others[place:]]
        assert_same_bits(simulator.run(asked)[place], outcomes["base"])


def test_a_request_gives_the_same_bits_beside_one_that_departs_at_another_time(
    simulator: JaxSimulator, requests: dict[str, RunRequest]
) -> None:
    alone = simulator.run([requests["later"]])[0]
    beside = simulator.run([requests["base"], requests["later"]])[1]
    assert alone.status is Status.OK
    assert_same_bits(alone, beside)


def test_an_unfinished_drive_ends_at_the_same_time_whoever_else_departs(
    simulator: JaxSimulator, requests: dict[str, RunRequest]
) -> None:
    alone = simulator.run([requests["ends later"]])[0]
    beside = simulator.run([requests["base"], requests["ends later"]])[1]
    assert told(alone)["last_s"] == told(beside)["last_s"] == pytest.approx(END_S, abs=0.5)


def test_a_run_that_is_interrupted_gives_the_same_bits_as_one_that_is_not(
    simulator: JaxSimulator, requests: dict[str, RunRequest], outcomes: dict[str, RunOutcome]
) -> None:
    """Two of three end early, so the third of each batch waits for the others of its kind."""
    lost = RunRequest((9e9, *requests["base"].values[1:]), 3, DEPART_S)  # no room: over at once
    asked = [requests["base"], lost, lost, requests["lazy"], lost, lost, requests["later"], lost]
    made = simulator.run(asked)
    alone = simulator.run([requests["later"]])[0]
    assert [outcome.status is Status.OK for outcome in made] == [request is not lost for request in asked]
    for place, expected in ((0, outcomes["base"]), (3, outcomes["lazy"]), (6, alone)):
        assert_same_bits(made[place], expected)


def test_another_behaviour_meets_the_same_arrivals(outcomes: dict[str, RunOutcome]) -> None:
    base, lazy = outcomes["base"], outcomes["lazy"]
    assert base.num_arrived.tolist() == lazy.num_arrived.tolist()
    assert told(base)["speeds"] != told(lazy)["speeds"]


def test_another_demand_or_seed_meets_other_arrivals(outcomes: dict[str, RunOutcome]) -> None:
    base, sparse = outcomes["base"], outcomes["sparse"]
    assert base.num_arrived[1] == sparse.num_arrived[1]  # the ramp's demand is the same
    assert sparse.num_arrived[0] < 0.7 * base.num_arrived[0]
    assert told(sparse)["objects"] < told(base)["objects"]
    assert base.num_arrived.tolist() != outcomes["other seed"].num_arrived.tolist()


def test_a_subject_vehicle_that_never_departs_is_a_failed_run(
    simulator: JaxSimulator, requests: dict[str, RunRequest]
) -> None:
    outcome = simulator.run([requests["never"]])[0]
    assert outcome.status is Status.SUBJECT_MISSING
    assert outcome.observed is None
    assert outcome.num_inserted.sum() > 0


def test_a_vector_with_a_number_that_is_none_is_a_failed_run_and_spoils_no_other(
    simulator: JaxSimulator, requests: dict[str, RunRequest], outcomes: dict[str, RunOutcome]
) -> None:
    values = list(requests["base"].values)
    values[simulator.layout.names.index("tau")] = float("nan")
    spoilt, base = simulator.run([RunRequest(tuple(values), 7, DEPART_S), requests["base"]])
    assert spoilt.status is Status.NONFINITE
    assert spoilt.observed is None
    assert_same_bits(base, outcomes["base"])


def test_all_of_this_takes_one_compiled_program(simulator: JaxSimulator, outcomes: dict[str, RunOutcome]) -> None:
    assert all(outcome.status is Status.OK for outcome in outcomes.values())
    assert simulator.capacity == 320  # rounded up, not grown
    assert simulator.batch == 3 * len(jax.devices())


@pytest.mark.parametrize("is_processor", [True, False])
def test_a_batch_has_runs_whatever_room_a_road_needs(is_processor: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """100,000 vehicles on one road fill more places than a batch of small ones has altogether."""
    monkeypatch.setattr(jax_simulator, "on_processors", lambda: is_processor)
    runs = [usual_runs_per_device(capacity) for capacity in (32, 416, 2_112, 16_416, 110_080, 4_000_000)]
    assert runs == ([16, 16, 4, 4, 4, 4] if is_processor else [4096, 4096, 512, 64, 64, 64])
