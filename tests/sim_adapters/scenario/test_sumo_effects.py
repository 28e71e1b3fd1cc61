"""Effects by SUMO's own means: what is written, that SUMO takes it, and that strength 0 leaves the scenario alone."""

import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.scenario_writer import WrittenScenario, write_scenario
from sim_adapters.scenario.sumo_effects import NotExpressibleError, expression_of, is_expressible
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import EFFECTS, effect_named

VALUES = (2750.0, 640.0, 1.3, 2.4, 2.7, 1.07, 0.14, 0.9, 3.5)
DEPART_S = 24.0
EXPRESSIBLE = [effect.name for effect in EFFECTS if expression_of(effect) is not None]
Write = Callable[..., WrittenScenario]


@pytest.fixture
def write(corridor: Scenario, layout: ParameterLayout, tmp_path: Path) -> Write:
    """Return a function that writes the corridor with effects into a folder of its own."""

    def written(folder: str, seed: int = 3, **strengths: float) -> WrittenScenario:
        (tmp_path / folder).mkdir()
        effects = {name: EffectSetting(strength) for name, strength in strengths.items()}
        return write_scenario(
            corridor, layout, VALUES, DEPART_S, "ego", tmp_path / folder, "run", effects=effects, seed=seed
        )

    return written


def text_of(written: WrittenScenario) -> tuple[str, ...]:
    return tuple(file.read_text() for file in (written.config, *written.files))


def vtypes(written: WrittenScenario) -> dict[str, ET.Element]:
    files = written.files
    return {one.get("id", ""): one for file in files for one in ET.parse(file).getroot().iter("vType")}


@pytest.mark.parametrize("name", EXPRESSIBLE)
def test_strength_0_is_the_scenario_without_and_more_is_not(name: str, write: Write):
    plain = text_of(write("plain"))
    assert text_of(write("none", **{name: 0.0})) == plain
    effect = effect_named(name)
    strongest = -effect.strong if effect.is_signed else effect.strong  # these drivers are fully willing as they are
    assert text_of(write("strong", **{name: strongest})) != plain


@pytest.mark.parametrize("name", EXPRESSIBLE)
def test_numbers_of_numpy_are_numbers(name: str, write: Write):
    strength = effect_named(name).medium
    assert text_of(write("numpy", **{name: np.float64(strength)})) == text_of(write("plain", **{name: strength}))


def test_what_sumo_has_no_means_for_is_refused(write: Write, corridor: Scenario):
    with pytest.raises(NotExpressibleError, match=r"grade.*reaction_delay"):
        write("grade", grade=0.02)
    assert not is_expressible(corridor, "grade")
    assert is_expressible(corridor, "keep_right")


def test_lorries_have_their_share_and_their_attributes(write: Write):
    found = vtypes(write("heavy", heavy_vehicles=0.12))
    cars, lorries = found["car-0"], found["car-1"]
    assert [float(one.get("probability", "")) for one in (cars, lorries)] == pytest.approx([0.88, 0.12])
    assert float(lorries.get("length", "")) == 13.5
    assert float(lorries.get("maxSpeed", "")) == pytest.approx(85 / 3.6)
    assert float(lorries.get("tau", "")) == pytest.approx(1.2 * float(cars.get("tau", "")))
    assert "subject" in found


def test_drivers_differ_by_the_coefficient_of_variation_asked_for(write: Write):
    found = [
        float(one.get("tau", ""))
        for seed in range(12)
        for name, one in vtypes(write(f"h{seed}", seed=seed, driver_heterogeneity=0.3)).items()
        if name.startswith("car")
    ]
    assert len(found) == 12 * 40
    assert np.mean(found) == pytest.approx(1.3, rel=0.05)
    assert np.std(found) / np.mean(found) == pytest.approx(0.3, rel=0.15)


def test_platoons_keep_the_flow_and_bunch_it(write: Write, corridor: Scenario):
    def departures(**strengths: float) -> np.ndarray:
        times = []
        for seed in range(8):
            root = ET.parse(write(f"p{len(strengths)}-{seed}", seed=seed, **strengths).files[-1]).getroot()
            own = [one for one in root.iter("vehicle") if one.get("id") != "ego"]
            seen = [float(one.get("depart", "")) for one in root.iter("vehicle")]
            assert seen == sorted(seen)
            times.append([float(one.get("depart", "")) for one in own])
        return np.asarray([np.histogram(one, np.arange(0.0, 600.0, 10.0))[0] for one in times])

    few, many = departures(platooned_arrivals=1e-9), departures(platooned_arrivals=0.6, keep_right=1.0)
    flow = VALUES[0] / 3600.0 * 10.0
    assert few.mean() == pytest.approx(flow, rel=0.08)
    assert many.mean() == pytest.approx(flow, rel=0.12)
    assert few.var() / few.mean() == pytest.approx(1.0, abs=0.35)  # Poisson
    assert many.var() / many.mean() > 1.6


def test_plain_sumo_takes_all_of_them(write: Write, start_sumo: Callable[..., subprocess.Popen], tmp_path: Path):
    several: dict[str, Any] = {name: effect_named(name).medium for name in EXPRESSIBLE}
    written = write("all", **several)
    process = start_sumo(40.0, "ego", None, "-c", written.config, "--seed", "5")
    assert process.wait() == 0


def test_platoons_come_no_longer_than_the_scenario_lasts(corridor: Scenario, layout: ParameterLayout, tmp_path: Path):
    endless = replace(corridor, flows=tuple(replace(flow, end_s=6e6) for flow in corridor.flows))
    effects = {"platooned_arrivals": EffectSetting(0.5)}
    written = write_scenario(endless, layout, VALUES, DEPART_S, "ego", tmp_path, "run", effects=effects, seed=3)
    departs_s = [float(one.get("depart", "")) for one in ET.parse(written.files[-1]).getroot().iter("vehicle")]
    assert corridor.end_s - 60.0 < max(departs_s) < corridor.end_s + 60.0
