"""Evidence that a single drive makes, and evidence that drives without any effect have."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, null_model
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.chance import best_gains, gain_by_chance
from jaxcalib.diagnosis.inference.investigation import Prepared, ramp_gains
from jaxcalib.diagnosis.inference.left_out import differences_of, left_out_sets
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    best_gain,
    explain,
    explain_none,
    explain_unknown,
    groups_of,
    log_densities,
    log_density,
)
from surrogate.effects.registry import effect_named

NUM_FEATURES, NUM_FIELD = 40, 8
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure_{k % 7}", f"regime {k}") for k in range(NUM_FEATURES))
MEAN = 5.0 + np.linspace(-1.0, 1.0, NUM_FEATURES)
EFFECTS = ("memory", "blockage")


def drives(number: int, seed: int, share_in_jam: float = 0.0, per_run: int = 1) -> DriveTallies:
    """Return drives, some of whose runs are in a jam, which moves features by far, each time others."""
    random = np.random.default_rng(seed)
    run = np.arange(number) // per_run
    in_jam = (random.random(run.max() + 1) < share_in_jam)[run]
    above = MEAN + 0.3 * random.standard_normal((number, NUM_FEATURES))
    above += 2.0 * random.standard_exponential((run.max() + 1, NUM_FEATURES))[run] ** 2 * in_jam[:, None]
    return DriveTallies(CELLS, above, np.ones_like(above), np.zeros(number), run)


def null_of(plain: DriveTallies, num_drives: int) -> NullModel:
    nothing = np.zeros((NUM_FEATURES, 1))
    below = np.full(NUM_FEATURES, float(num_drives))
    return null_model(CELLS, below, plain, nothing, nothing, np.ones(1), None, num_drives)


def prepared(field: DriveTallies, plain: DriveTallies) -> Prepared:
    null = null_of(plain, len(field))
    left_out = left_out_sets(plain, len(field), lambda some: null_of(some, len(field)))
    nothing = cast(Any, None)
    return Prepared(field, null, null.standardised(field.values()), nothing, np.ones(NUM_FEATURES), left_out)


def without_each(some: Prepared, plain: DriveTallies) -> np.ndarray:
    return differences_of(some.tallies, some.null, 1.0 / plain.num_independent)[1:]


def chance(some: Prepared) -> float:
    return gain_by_chance(some.left_out, some.null, signatures(), {})


def signatures(size: float = 3.0) -> dict[str, list[Signature]]:
    made = {}
    for number, name in enumerate(EFFECTS):
        medium = effect_named(name).medium
        shift = size * np.random.default_rng(number).standard_normal(NUM_FEATURES)
        shifts = np.stack([0.0 * shift, shift, 2.0 * shift])
        made[name] = [Signature(name, {}, medium * np.arange(3.0), shifts, np.full((3, NUM_FEATURES), 0.1))]
    return made


def test_densities_of_several_are_those_of_each():
    random = np.random.default_rng(1)
    root = random.standard_normal((5, 5))
    covariance, differences = root @ root.T + np.eye(5), random.standard_normal((3, 5))
    values, squares = log_densities(differences, covariance)
    for each, value, square in zip(differences, values, squares, strict=True):
        assert log_density(each, covariance) == pytest.approx((value, square))
        assert square == pytest.approx(each @ np.linalg.inv(covariance) @ each)


def test_gains_of_several_are_those_of_each():
    field, plain = drives(NUM_FIELD, 1), drives(48, 2)
    some, places = prepared(field, plain), {"blockage": 7}
    differences = np.stack([some.difference, some.difference + signatures()["blockage"][0].shift[1]])
    gains = best_gains(differences, some.null, signatures(), places)
    for difference, gain in zip(differences, gains, strict=True):
        explained = [explain_none(difference, some.null)]
        explained.append(explain_unknown(difference, some.null, groups_of(CELLS)))
        for name, several in signatures().items():
            explained.append(explain(difference, some.null, several, effect_named(name).medium, places.get(name, 1)))
        assert gain == pytest.approx(best_gain(explained))
    assert gains[0] < 2.0 < 20.0 < gains[1]


def test_what_one_drive_makes_is_gone_without_it_and_what_all_make_is_not():
    plain = drives(48, 2)
    one, everyone = drives(NUM_FIELD, 3), drives(NUM_FIELD, 3)
    one.above[5, ::2] += 4.0
    everyone.above[:, ::2] += 0.5
    for field, is_sure in ((one, False), (everyone, True)):
        some = prepared(field, plain)
        gains = best_gains(without_each(some, plain), some.null, {}, {})
        assert best_gains(some.difference[None], some.null, {}, {})[0] > 10.0
        assert bool(gains.min() > 5.0) is is_sure
        assert np.argmin(gains) == 5 or is_sure


def test_roads_that_jam_now_and_then_ask_for_more_evidence():
    def of_road(share_in_jam: float) -> float:
        return chance(prepared(drives(NUM_FIELD, 6), drives(60, 5, share_in_jam, per_run=2)))

    assert of_road(0.0) < 5.0 < 10.0 < of_road(0.1)


def test_a_field_without_effect_has_hardly_ever_more_than_chance():
    """Where null runs know of jams; one that none of them has stays an alarm."""
    above = above_least = 0
    for seed in range(30):
        plain, field = drives(40, 3 * seed, 0.25, per_run=2), drives(NUM_FIELD, 3 * seed + 1, 0.25)
        some = prepared(field, plain)
        gain = best_gains(without_each(some, plain), some.null, signatures(), {}).min()
        above += bool(gain > max(5.0, chance(some)))
        above_least += bool(gain > 5.0)
    assert above / 30 <= 0.1
    assert above_least / 30 > 0.3  # the least evidence alone would let them pass


def test_signatures_count_in_the_units_of_the_field():
    """Sets whose null model has other deviations are judged by the same signatures."""
    some = prepared(drives(NUM_FIELD, 6), drives(60, 5))
    units = np.linspace(0.5, 2.0, NUM_FEATURES)
    others = [
        replace(
            each,
            null=replace(
                each.null,
                deviation=each.null.deviation * units,
                covariance=each.null.covariance / np.outer(units, units),
            ),
            differences=each.differences / units,
        )
        for each in some.left_out
    ]
    assert gain_by_chance(others, some.null, signatures(), {}) == pytest.approx(chance(some))
    assert gain_by_chance((), some.null, signatures(), {}) == 0.0


def test_roads_without_ramps_gain_nothing_by_them(monkeypatch: pytest.MonkeyPatch):
    from jaxcalib.diagnosis.inference import investigation

    some = prepared(drives(NUM_FIELD, 1), drives(48, 2))
    seen = []

    def ratios(problem: Any, values: Any, of: Prepared) -> tuple[dict[int, tuple[float, float]], float]:
        seen.append(of.difference)
        return ({1: (float(of.difference[0]), 0.02)} if problem else {}), 1.0

    monkeypatch.setattr(investigation, "input_ratios", ratios)
    differences = np.stack([np.full(NUM_FEATURES, 1.0), np.full(NUM_FEATURES, 1.6)])
    assert ramp_gains(cast(Any, None), np.ones(1), some, differences) == [-np.inf, -np.inf]
    usual, wrong = ramp_gains(cast(Any, "one ramp"), np.ones(1), some, differences)
    assert usual < 0.0 < 5.0 < wrong
    np.testing.assert_array_equal(seen[-1], differences[-1])
