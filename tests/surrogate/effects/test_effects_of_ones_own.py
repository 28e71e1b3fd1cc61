"""The example of docs/effects.md: one file and one entry are enough."""

import re

import numpy as np
import pytest

import surrogate.effects.apply
import surrogate.effects.settings
from surrogate.effects.base import Effect, EffectSetting
from surrogate.effects.registry import EFFECT_NUMBER, EFFECTS
from tests.places import ROOT
from tests.surrogate.effects.effects_stage import S0, V0, A, B, T, drive, platoon

PAGE = ROOT / "docs/effects.md"


@pytest.fixture
def sun_glare(monkeypatch: pytest.MonkeyPatch) -> Effect:
    """Return the effect of the page, entered in the registry."""
    (code,) = re.findall(r"```python\n(\"\"\"Low sun.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    module: dict[str, Effect] = {}
    exec(compile(code, "sun_glare.py", "exec"), module)
    effect = module["SUN_GLARE"]
    everything = (*EFFECTS, effect)
    monkeypatch.setitem(EFFECT_NUMBER, effect.name, len(EFFECTS))
    monkeypatch.setattr("surrogate.effects.registry.EFFECTS", everything)
    monkeypatch.setattr(surrogate.effects.apply, "EFFECTS", everything)
    monkeypatch.setattr(surrogate.effects.settings, "EFFECTS", everything)
    return effect


def test_the_example_of_the_page_works(sun_glare: Effect) -> None:
    settings = {sun_glare.name: EffectSetting(0.25, route_from_m=440.0, route_to_m=505.0)}
    start = [520.0, 490.0, 460.0, 430.0, 400.0, 370.0], [14.0, 15.0, 13.0, 14.0, 15.0, 13.0]
    first = drive(platoon(*start, settings), settings).acceleration_mps2[0]

    def idm(v: float, gap: float, leader: float) -> float:
        wanted = S0 + v * T + v * (v - leader) / (2.0 * np.sqrt(A * B))
        return A * (1.0 - (v / V0) ** 4 - (wanted / gap) ** 2)

    gap = 30.0 - 4.8
    assert first[3] == pytest.approx(idm(13.0, 0.75 * gap, 15.0), abs=2e-4)
    assert first[4] == pytest.approx(idm(14.0, gap, 13.0), abs=2e-4)
    bare, off = drive(platoon(*start, {}), {}), {sun_glare.name: EffectSetting(0.0, 440.0, 505.0)}
    assert drive(platoon(*start, off), off).position_m.tobytes() == bare.position_m.tobytes()
