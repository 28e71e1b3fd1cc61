"""The tables of transfer and insertion, on simulators whose differences are known."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from experiments.fidelity.__main__ import show_insertion, show_transfer
from experiments.fidelity.transfer import LEVELS, Transfer, cases_of, transfer_of
from jaxcalib.calibration.stages.evaluator import Evaluations
from jaxcalib.measures.measure import Level, Measure

NAMES = ("main", "tau", "lcAssertive")
TALLIES = ("speed", "frames", "drives")


def problem() -> SimpleNamespace:
    layout = SimpleNamespace(names=NAMES, input_ids=NAMES[:1])
    return SimpleNamespace(
        layout=layout,
        template=SimpleNamespace(base_values=lambda: np.asarray([4000.0, 1.0, 1.0])),
        measures={"speed_mps": Measure("speed_mps", "", Level.TRAFFIC, "speed", "frames")},
        tally_index={name: place for place, name in enumerate(TALLIES)},
    )


def evaluations(mean_mps: np.ndarray, seed: int, failed: tuple[int, ...] = ()) -> Evaluations:
    """Return eight runs of each case with a noise of 0.2 m/s."""
    speed = mean_mps[:, None] + 0.2 * np.random.default_rng(seed).standard_normal((len(mean_mps), 8))
    tally = np.stack([50.0 * speed, np.full_like(speed, 50.0), np.ones_like(speed)], axis=2)
    is_ok = ~np.isin(np.arange(len(mean_mps)), failed)
    tally[~is_ok] = np.nan
    return Evaluations(tally, is_ok, ())


def found(theirs_from_ours: float = 1.0, failed: tuple[int, ...] = ()) -> Transfer:
    """Compare simulators in which speed falls with demand and rises with assertiveness; tau does nothing."""
    array, _ = cases_of(problem())  # pyright: ignore[reportArgumentType]
    centred = array.levels / 3.0 - 0.5
    mean = 20.0 - 4.0 * centred[:, 0] + 2.0 * centred[:, 2]
    ours, theirs = evaluations(theirs_from_ours * mean, 1, failed), evaluations(mean, 2)
    return transfer_of(problem(), array, ours, theirs)  # pyright: ignore[reportArgumentType]


def test_cases_span_the_ranges_evenly() -> None:
    array, values = cases_of(problem())  # pyright: ignore[reportArgumentType]
    assert values.shape == (64, 3)
    assert sorted(set(values[:, 0])) == pytest.approx([3200.0, 3733.33, 4266.67, 4800.0])
    assert (values[:, 1].min(), values[:, 1].max()) == LEVELS["tau"]
    assert all(np.sum(array.levels[:, place] == level) == 16 for place in range(3) for level in range(4))


def test_simulators_that_agree_are_found_to_and_a_factor_is_a_bias() -> None:
    (same,) = found().measures
    assert same.rank_correlation > 0.98
    assert abs(same.bias) < 0.01
    (slower,) = found(0.8).measures
    assert slower.bias == pytest.approx(-0.2, abs=0.01)
    effects = {one.parameter: one for one in found(0.8).effects}
    assert effects["main"].sumo == pytest.approx(-4.0, abs=0.15)
    assert effects["main"].ratio == pytest.approx(0.8, abs=0.05)
    assert effects["lcAssertive"].sumo == pytest.approx(2.0, abs=0.15)
    assert [name for name, one in effects.items() if one.counts] == ["main", "lcAssertive"]


def test_a_simulator_that_answers_the_other_way_is_found_out() -> None:
    (opposite,) = found(-1.0).measures
    assert opposite.rank_correlation < -0.98
    assert all(one.ratio < 0.0 for one in found(-1.0).effects if one.counts)


def test_cases_that_failed_in_one_simulator_count_in_neither() -> None:
    some = found(failed=(3, 17, 40))
    assert some.num_failed == (3, 0)
    assert some.measures[0].rank_correlation > 0.98


def test_the_tablesshow_what_is_missed_and_can_be_written() -> None:
    console = Console(record=True, width=140)
    show_transfer(console, found(0.8))
    row = {
        "input": "on1",
        "demand_vehph": 1690.0,
        "sumo_share": np.float64(0.979),
        "surrogate_share": np.float64(0.892),
    }
    show_insertion(console, [row, row | {"surrogate_share": 0.97}])
    text = console.export_text()
    assert "-20.0%  no" in text.replace("-19.9%", "-20.0%").replace("-20.1%", "-20.0%")
    assert "sign right in 2" in text
    assert ("-8.7%  no" in text, "-0.9%  no" in text) == (True, False)
    json.dumps([row, *(vars(one) | {"counts": one.counts} for one in found().effects)])
