"""Several subject vehicles on one road of the surrogate: each sees what it would alone until others are near."""

import dataclasses

import numpy as np
import pytest

from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.effects.base import EffectSetting
from surrogate.subject.registry import SubjectModel
from tests.sim_adapters.jax.frame_trace import BEHIND_M, COLUMN, OFFSETS, corridor_engine

pytestmark = pytest.mark.long

FIRST_S, SECOND_S = 61.0, 69.0
OTHERS, OTHERS_OFFSETS, TRACK = (COLUMN[name] for name in ("others", "others_offsets", "largest_track"))


@pytest.fixture(scope="module")
def values(template: WorldTemplate) -> tuple[float, ...]:
    base = dict(zip(template.layout.names, template.base_values().tolist(), strict=True))
    return tuple((base | {"main": 3400.0}).values())


@pytest.fixture(scope="module")
def outcomes(simulator: JaxSimulator, values: tuple[float, ...]) -> list[RunOutcome]:
    return simulator.run(
        [
            RunRequest(values, 7, SECOND_S, also_depart_s=(FIRST_S,)),
            RunRequest(values, 7, FIRST_S),
            RunRequest(values, 7, FIRST_S, also_depart_s=(SECOND_S,)),
            RunRequest(values, 8, FIRST_S, also_depart_s=(SECOND_S,)),
        ]
    )


def drive_of(outcome: RunOutcome) -> np.ndarray:
    assert outcome.status is Status.OK
    return outcome.observed


def test_until_the_second_enters_the_first_drives_as_if_alone(outcomes: list[RunOutcome]):
    _, alone, first, _ = map(drive_of, outcomes)
    before = slice(0, round(SECOND_S / 0.5))
    assert (alone[before, 0] > 0).sum() > 10
    np.testing.assert_allclose(first[before], alone[before], rtol=1e-5, atol=1e-3)


def test_each_has_a_drive_of_its_own_and_sees_the_other(outcomes: list[RunOutcome]):
    second, _, first, _ = map(drive_of, outcomes)
    both = (first[:, 0] > 0) & (second[:, 0] > 0)
    assert both.sum() > 50
    assert np.flatnonzero(second[:, 0])[0] * 0.5 >= SECOND_S
    ahead_m = first[both, 1] - second[both, 1]
    assert np.all(np.abs(ahead_m) > 1.0)
    near = np.abs(ahead_m) < BEHIND_M - 1.0
    assert near.sum() > 10
    for drive, offset_m in ((first, -ahead_m), (second, ahead_m)):
        nearest_m = np.abs(drive[both, OFFSETS] - offset_m[:, None]).min(axis=1)
        assert np.all(nearest_m[near] < 0.01)  # where the other is, there is an object


def test_each_numbers_who_it_sees_from_0_on(outcomes: list[RunOutcome]):
    for drive in map(drive_of, outcomes):
        seen = drive[drive[:, 0] > 0]
        assert seen[0, TRACK] == seen[0, OTHERS] - 1  # everybody is new in the first frame
        new = np.diff(np.maximum.accumulate(seen[:, TRACK]))
        assert np.all(new <= seen[1:, OTHERS])  # numbers follow each other
        assert new.sum() > 0


def test_a_shared_run_is_the_same_in_any_batch(simulator: JaxSimulator, outcomes: list[RunOutcome]):
    again = simulator.run([outcome.request for outcome in (outcomes[3], outcomes[2])])
    assert again[0].observed.tobytes() == outcomes[3].observed.tobytes()
    assert again[1].observed.tobytes() == outcomes[2].observed.tobytes()
    assert outcomes[0].wall_s == outcomes[2].wall_s
    assert not np.array_equal(drive_of(outcomes[2]), drive_of(outcomes[3]))  # another seed


def test_effects_off_are_no_effects_and_sensors_are_each_vehicle_s_own(
    with_effects: JaxSimulator, outcomes: list[RunOutcome]
):
    biased = {"gap_sensor_bias": EffectSetting(0.1)}
    requests = [
        dataclasses.replace(outcomes[index].request, effects=effects) for effects in ({}, biased) for index in (0, 2)
    ]
    second, first, biased_second, biased_first = map(drive_of, with_effects.run(requests))
    assert second.tobytes() == drive_of(outcomes[0]).tobytes()
    assert first.tobytes() == drive_of(outcomes[2]).tobytes()
    for plain, off in ((second, biased_second), (first, biased_first)):
        np.testing.assert_array_equal(plain[:, :3], off[:, :3])  # a sensor's bias moves nobody
        few = (plain[:, OTHERS] > 0) & (plain[:, OTHERS] == off[:, OTHERS])
        assert few.sum() > 10
        np.testing.assert_allclose(off[few, OTHERS_OFFSETS], 1.1 * plain[few, OTHERS_OFFSETS], rtol=1e-4, atol=1e-2)


def test_a_vehicle_with_a_driver_of_its_own_is_the_only_one(template: WorldTemplate, values: tuple[float, ...]):
    planned = dataclasses.replace(template, subject_model=SubjectModel("planner"))
    with pytest.raises(ValueError, match="one subject vehicle"):
        corridor_engine(planned).run([RunRequest(values, 1, FIRST_S, also_depart_s=(SECOND_S,))])
