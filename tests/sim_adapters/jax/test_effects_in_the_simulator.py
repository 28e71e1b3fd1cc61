"""Runs of the corridor with effects: one program, the baseline's bits where all are off, common random numbers."""

from collections.abc import Mapping

import numpy as np
import pytest

from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.effects.base import ActsOn, EffectSetting
from surrogate.effects.registry import EFFECT_NAMES, EFFECTS

pytestmark = pytest.mark.long

DEPART_S = 130.0
EVENT_S = 180.0
PLACES = {
    "grade": {"route_from_m": 900.0, "route_to_m": 1700.0},
    "local_speed_reduction": {"route_from_m": 900.0, "route_to_m": 1300.0},
    "rubbernecking": {"route_from_m": 900.0, "route_to_m": 1600.0, "time_from_s": EVENT_S, "time_to_s": 250.0},
    "blockage": {"route_from_m": 1800.0, "time_from_s": EVENT_S, "choice": 2.0},
}


def request(
    template: WorldTemplate, seed: int, effects: Mapping[str, EffectSetting] | None = None, **changes: float
) -> RunRequest:
    values = dict(zip(template.layout.names, template.base_values(), strict=True)) | {"main": 3500.0} | changes
    return RunRequest(tuple(values.values()), seed, DEPART_S, effects or {})


@pytest.fixture(scope="module")
def outcomes(with_effects: JaxSimulator, template: WorldTemplate) -> dict[str, RunOutcome]:
    """One run with each effect at its strong end, and one without any; all of the same seed."""
    mixes = {"none": {}} | {
        effect.name: {effect.name: EffectSetting(effect.strong, **PLACES.get(effect.name, {}))} for effect in EFFECTS
    }
    made = with_effects.run([request(template, 11, mix) for mix in mixes.values()])
    return dict(zip(mixes, made, strict=True))


def test_all_off_gives_the_baseline_bit_for_bit(
    simulator: JaxSimulator, with_effects: JaxSimulator, template: WorldTemplate
) -> None:
    off = {
        name: EffectSetting(0.0, 700.0, 1900.0, 150.0, 240.0, choice=1.0, time_constant_s=9.0) for name in EFFECT_NAMES
    }
    worlds = [{}, {"tau": 1.7, "accel": 1.2}, {"main": 4100.0, "on1": 700.0}, {"speedFactor": 0.9, "lcStrategic": 4.0}]
    usual = simulator.run([request(template, 3 + seed, **world) for seed, world in enumerate(worlds)])
    bare = with_effects.run([request(template, 3 + seed, **world) for seed, world in enumerate(worlds)])
    strong = {effect.name: EffectSetting(effect.medium) for effect in EFFECTS}
    mixed = [request(template, 3 + seed, off, **world) for seed, world in enumerate(worlds)]
    dialled = with_effects.run([*mixed, request(template, 3, strong)])[:-1]  # whoever else is in the batch
    for one, two, three in zip(usual, bare, dialled, strict=True):
        assert one.status is Status.OK
        assert one.observed.tobytes() == two.observed.tobytes() == three.observed.tobytes()
        assert one.num_inserted.tolist() == two.num_inserted.tolist() == three.num_inserted.tolist()
        assert one.num_vehicle_steps == two.num_vehicle_steps == three.num_vehicle_steps


def test_a_simulator_without_effects_refuses_them(simulator: JaxSimulator, template: WorldTemplate) -> None:
    with pytest.raises(ValueError, match="with_effects"):
        simulator.run([request(template, 3, {"grade": EffectSetting(0.02)})])


def test_all_strengths_run_in_one_program(
    with_effects: JaxSimulator, template: WorldTemplate, outcomes: dict[str, RunOutcome]
) -> None:
    assert len(outcomes) == 1 + len(EFFECTS)
    compile_s = with_effects.compile_s
    pair = {"grade": EffectSetting(0.011, 500.0, 900.0), "reaction_delay": EffectSetting(0.83)}
    assert with_effects.run([request(template, 5, pair)])[0].status is Status.OK
    assert with_effects.compile_s == compile_s


@pytest.mark.parametrize("effect", EFFECTS, ids=EFFECT_NAMES)
def test_each_effect_shows_in_the_frames(outcomes: dict[str, RunOutcome], effect: object) -> None:
    name = effect.name  # pyright: ignore[reportAttributeAccessIssue]
    assert outcomes[name].status is Status.OK
    if name == "cooperative_yielding":
        return  # the corridor's drivers are as willing as can be; see the test below
    assert outcomes[name].observed.tobytes() != outcomes["none"].observed.tobytes()


def test_less_yielding_shows_where_drivers_are_willing(with_effects: JaxSimulator, template: WorldTemplate) -> None:
    crowd = {"main": 4400.0, "on1": 900.0}
    less = {"cooperative_yielding": EffectSetting(-0.9)}
    usual, other = with_effects.run([request(template, 11, {}, **crowd), request(template, 11, less, **crowd)])
    assert usual.observed.tobytes() != other.observed.tobytes()


def test_sensors_change_what_is_seen_and_never_what_happens(outcomes: dict[str, RunOutcome]) -> None:
    for effect in EFFECTS:
        if effect.acts_on is ActsOn.SENSOR:
            there, usual = outcomes[effect.name], outcomes["none"]
            np.testing.assert_array_equal(there.observed[:, :3], usual.observed[:, :3])
            assert there.num_vehicle_steps == usual.num_vehicle_steps


@pytest.mark.parametrize("name", ["rubbernecking", "blockage"])
def test_an_event_changes_nothing_before_its_time(outcomes: dict[str, RunOutcome], name: str) -> None:
    usual, other = outcomes["none"].observed, outcomes[name].observed
    time_s = usual[:, 0]
    before = (time_s > 0.0) & (time_s < EVENT_S - 10.0)  # a vehicle that is to stop begins to brake earlier
    assert before.sum() > 60
    np.testing.assert_array_equal(other[before], usual[before])
    assert (other[: len(usual)] != usual).any()


@pytest.mark.parametrize("name", ["grade", "local_speed_reduction"])
def test_a_place_changes_nothing_before_the_first_vehicle_could_carry_word_of_it(
    with_effects: JaxSimulator, template: WorldTemplate, name: str
) -> None:
    """Word of a slope or a limit at 2950 m travels upstream with the queue only."""
    there = {name: EffectSetting(0.04 if name == "grade" else 0.2, 2950.0, 3100.0)}
    usual, other = with_effects.run([request(template, 21), request(template, 21, there)])
    early = (usual.observed[:, 0] > 0.0) & (usual.observed[:, 1] < 600.0)
    assert early.sum() > 15
    np.testing.assert_array_equal(other.observed[early], usual.observed[early])


def test_the_blocked_lane_holds_up_those_behind(outcomes: dict[str, RunOutcome]) -> None:
    usual, blocked = outcomes["none"].observed, outcomes["blockage"].observed
    assert blocked[:, 2][blocked[:, 0] > EVENT_S].mean() < usual[:, 2][usual[:, 0] > EVENT_S].mean() - 1.0
