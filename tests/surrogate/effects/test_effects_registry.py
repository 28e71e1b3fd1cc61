"""What every effect says of itself, and the settings that callers make."""

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

from surrogate import effects
from surrogate.effects import registry
from surrogate.effects.base import ActsOn, Dial, Effect, EffectSetting, Hook
from surrogate.effects.registry import EFFECT_NAMES, EFFECT_NUMBER, EFFECTS, UnknownEffectError, effect_named
from surrogate.effects.settings import settings_table

# functions that an effect has or has not; the other fields describe it
HOOKS = [field.name for field in dataclasses.fields(Effect) if field.type == Hook]


def test_each_file_s_effect_is_in_the_registry_once_under_the_file_s_name() -> None:
    modules = [
        importlib.import_module(f"{effects.__name__}.{module.name}")
        for module in pkgutil.iter_modules(effects.__path__)
    ]
    written = {
        module.__name__.rpartition(".")[2]: value
        for module in modules
        if module is not registry
        for value in vars(module).values()
        if isinstance(value, Effect)
    }
    assert len(written) > 1
    assert set(written) == set(EFFECT_NAMES)
    assert all(written[effect.name] is effect for effect in EFFECTS)
    assert len(set(EFFECT_NAMES)) == len(EFFECTS)
    assert [EFFECT_NUMBER[name] for name in EFFECT_NAMES] == list(range(len(EFFECTS)))


@pytest.mark.parametrize("effect", EFFECTS, ids=EFFECT_NAMES)
def test_an_effect_says_what_it_is(effect: Effect) -> None:
    assert 0.0 < effect.weak < effect.medium < effect.strong
    assert effect.title
    assert effect.unit
    assert len(effect.source) > 20
    assert isinstance(effect.acts_on, ActsOn)
    hooks = {hook for hook in HOOKS if getattr(effect, hook) is not None}
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
