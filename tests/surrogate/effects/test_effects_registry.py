"""What every effect says of itself, and the settings that callers make."""

import numpy as np
import pytest

from surrogate.effects.base import ActsOn, Dial, Effect, EffectSetting
from surrogate.effects.registry import EFFECT_NAMES, EFFECT_NUMBER, EFFECTS, UnknownEffectError, effect_named
from surrogate.effects.settings import settings_table

# as results name them
NAMES = """
reaction_delay multi_anticipation acceleration_noise driver_heterogeneity memory slow_start lane_change_relaxation
cooperative_yielding lane_change_duration keep_right grade local_speed_reduction heavy_vehicles platooned_arrivals
ramp_inflow_error blockage rubbernecking gap_sensor_bias sensor_noise sensor_latency sensor_range subject_actuation_lag
"""
HOOKS = """
inputs arrival newcomer behaviour new_class begin road perceive adapt command actuate remember decide settle appear
watch sense
"""


def test_the_library_holds_what_results_can_name() -> None:
    assert list(EFFECT_NAMES) == NAMES.split()


@pytest.mark.parametrize("effect", EFFECTS, ids=EFFECT_NAMES)
def test_an_effect_says_what_it_is(effect: Effect) -> None:
    assert 0.0 < effect.weak < effect.medium < effect.strong
    assert effect.title
    assert effect.unit
    assert len(effect.source) > 20
    assert isinstance(effect.acts_on, ActsOn)
    hooks = {hook for hook in HOOKS.split() if getattr(effect, hook) is not None}
    assert hooks
    if hooks & {"remember", "settle"}:
        assert "begin" in hooks
    assert (effect.acts_on is ActsOn.SENSOR) == ("sense" in hooks)


def test_settings_left_out_are_everywhere_always_and_the_effect_s_own() -> None:
    table = settings_table({"blockage": EffectSetting(70.0, route_from_m=1200.0, time_from_s=350.0, choice=2.0)})
    assert table.shape == (len(EFFECTS), len(Dial.FIELDS))
    row = dict(zip(Dial.FIELDS, table[EFFECT_NUMBER["blockage"]].tolist(), strict=True))
    assert row["strength"] == 70.0
    assert (row["route_from_m"], row["time_from_s"], row["choice"]) == (1200.0, 350.0, 2.0)
    assert row["route_to_m"] > 1e6
    others = np.delete(table, EFFECT_NUMBER["blockage"], axis=0)
    assert (others[:, 0] == 0.0).all()
    assert table[EFFECT_NUMBER["memory"], Dial.FIELDS.index("time_constant_s")] == 60.0


def test_an_unknown_effect_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownEffectError, match="known are reaction_delay, "):
        settings_table({"weather": EffectSetting(0.1)})
    assert effect_named("grade").name == "grade"
