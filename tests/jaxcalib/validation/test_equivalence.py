"""The same within a margin: how often it is said wrongly, when it is said rightly, and what is asked for otherwise."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from jaxcalib.errors import CaseError
from jaxcalib.measures.measure import Level, Measure, Moe
from jaxcalib.validation.equivalence import (
    DIFFERENT,
    EQUIVALENT,
    OPEN,
    _verdict,
    compare_within_margins,
    fieller_interval,
)
from jaxcalib.validation.margins import MARGINS, USER, Margin, read_margins
from jaxcalib.validation.observer import ObservedDrives

MEASURES = {
    "traffic_speed_mps": Measure("traffic_speed_mps", "", Level.TRAFFIC, "distance", "time", moe=Moe.TRAFFIC_SPEED),
    "other": Measure("other", "", Level.TRAFFIC, "distance", "time"),
}
NAMES = ("distance", "time")


def observed(random: np.random.Generator, speed_mps: float, *shape: int) -> ObservedDrives:
    """Return drives of unequal length whose speeds scatter by a tenth."""
    time_s = random.uniform(40.0, 120.0, shape)
    speeds = speed_mps * random.normal(1.0, 0.1, shape)
    return ObservedDrives(np.stack([speeds * time_s, time_s], axis=-1), {}, np.zeros((*shape, 1)))


def compared(seed: int, num_drives: int, simulated_mps: float, share: float = 0.1) -> dict:
    random = np.random.default_rng(seed)
    field, rounds = observed(random, 20.0, num_drives), observed(random, simulated_mps, 12, num_drives)
    margins = dict.fromkeys(Moe, Margin(share, "here"))
    return compare_within_margins(MEASURES, margins, NAMES, field, rounds, random)["traffic_speed_mps"]


@pytest.mark.parametrize("num_drives", [4, 8])
def test_what_is_as_far_apart_as_the_margin_is_called_the_same_in_one_of_twenty_cases(num_drives: int):
    said = [compared(seed, num_drives, 22.0)["verdict"] for seed in range(150)]
    assert stats.binomtest(said.count(EQUIVALENT), len(said), 0.05, alternative="greater").pvalue > 1e-3
    assert said.count(DIFFERENT) <= 0.1 * len(said)


def test_enough_drives_show_that_two_are_the_same_and_that_two_are_not():
    same = [compared(seed, 40, 20.2) for seed in range(10)]
    assert [one["verdict"] for one in same].count(EQUIVALENT) >= 9
    assert all(one["more_drives"] == 0 for one in same if one["verdict"] == EQUIVALENT)
    other = [compared(seed, 40, 25.0) for seed in range(10)]
    assert {one["verdict"] for one in other} == {DIFFERENT}
    low, high = other[0]["interval_90"]
    assert low < other[0]["difference"] < high
    assert other[0]["source"] == "here"
    assert "other" not in compare_within_margins(
        MEASURES, MARGINS, NAMES, observed(np.random.default_rng(1), 20.0, 4),
        observed(np.random.default_rng(2), 20.0, 4, 4), np.random.default_rng(3),
    )  # fmt: skip


def test_what_nothing_is_known_of_stays_open():
    assert compared(1, 2, 20.0)["verdict"] == OPEN  # too few drives to know an error
    assert compared(1, 2, 20.0)["more_drives"] is None
    nothing = ObservedDrives(np.zeros((4, 2)), {}, np.zeros((4, 1)))
    rounds = observed(np.random.default_rng(2), 20.0, 5, 4)
    found = compare_within_margins(MEASURES, MARGINS, NAMES, nothing, rounds, np.random.default_rng(3))
    assert found["traffic_speed_mps"]["verdict"] == OPEN
    assert found["traffic_speed_mps"]["note"] == "never observed"


def test_the_drives_that_are_asked_for_would_tell():
    """With n times the drives the interval is narrower by the root of n."""
    entry = _verdict(0.04, (-0.05, 0.13), 0.1, 8)
    assert entry["verdict"] == OPEN
    more = entry["more_drives"]
    for number, verdict in ((more, EQUIVALENT), (more - 1, OPEN)):
        narrower = 0.09 * np.sqrt(8 / (8 + number))
        assert _verdict(0.04, (0.04 - narrower, 0.04 + narrower), 0.1, 8 + number)["verdict"] == verdict
    assert _verdict(-0.2, (-0.35, -0.05), 0.1, 8)["more_drives"] == 10  # to show that it is different
    assert _verdict(0.1, (-0.05, 0.25), 0.1, 8)["more_drives"] == 999


def test_margins_are_changed_in_one_table(tmp_path: Path):
    file = tmp_path / "margins.toml"
    file.write_text("[margins]\ncut_ins = 0.5\n", encoding="utf-8")
    margins = read_margins(file)
    assert margins[Moe.CUT_INS] == Margin(0.5, USER)
    assert margins[Moe.TRAFFIC_SPEED] == MARGINS[Moe.TRAFFIC_SPEED]
    assert read_margins(None) == MARGINS
    assert set(MARGINS) == set(Moe)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[margins]\ncutins = 0.5\n", "cut_ins"),
        ("[margins]\ncut_ins = 0\n", "above 0"),
        ("[margins]\ncut_ins = 'a'\n", "expected TOML"),
        ("[margin]\n", "expected TOML"),
        ("cut_ins = \n", "expected TOML"),
    ],
)
def test_wrong_margins_are_refused_by_name(tmp_path: Path, text: str, said: str):
    file = tmp_path / "margins.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(CaseError, match=said) as error:
        read_margins(file)
    assert "margins.toml" in str(error.value)


def test_hours_that_differ_make_no_difference_uncertain():
    """Speeds of 8 to 32 m/s by the hour, the same in field and simulation: each drive is compared with its own runs."""
    said = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        hour_mps = np.linspace(8.0, 32.0, 8)
        field, rounds = observed(random, 1.0, 8), observed(random, 1.0, 12, 8)
        for one in (field, rounds):
            one.tally[..., 0] *= hour_mps
        margins = dict.fromkeys(Moe, Margin(0.15, "here"))
        arguments = (MEASURES, margins, NAMES, field, rounds)
        together = compare_within_margins(*arguments, np.random.default_rng(1))["traffic_speed_mps"]
        apart = compare_within_margins(*arguments, np.random.default_rng(1), shares_drives=False)["traffic_speed_mps"]
        low, high = together["interval_90"]
        wide_low, wide_high = apart["interval_90"]
        assert wide_high - wide_low > 1.5 * (high - low)
        assert apart["verdict"] == OPEN
        said.append((together["verdict"], low < 0.0 < high))
    assert sum(verdict == EQUIVALENT for verdict, _ in said) >= 10
    assert stats.binomtest(sum(holds for _, holds in said), len(said), 0.9, alternative="less").pvalue > 1e-2


def test_an_interval_with_a_covariance_holds_its_rate():
    random, quantile = np.random.default_rng(7), float(stats.norm.ppf(0.95))
    shared = random.normal(0.0, 1.0, 4000)
    fields = 10.0 + shared + random.normal(0.0, 0.3, 4000)
    simulated = 1.2 * (10.0 + shared) + random.normal(0.0, 0.4, 4000)
    ends = np.asarray(
        [fieller_interval(s, f, 1.44 + 0.16, 1.09, quantile, 1.2) for s, f in zip(simulated, fields, strict=True)]
    )
    for outside in (ends[:, 1] < 0.2, ends[:, 0] > 0.2):
        assert np.mean(outside) == pytest.approx(0.05, abs=0.011)


@pytest.mark.parametrize("margin", [-0.5, 0.3, 1.0, 2.0])
def test_both_ends_of_the_interval_hold_their_rate_at_margins_of_any_size(margin: float):
    """Truth at the margin, errors known: in one case of twenty the interval ends before it, and beyond it."""
    random, quantile = np.random.default_rng(6), float(stats.norm.ppf(0.95))
    fields, simulated = random.normal(10.0, 1.0, 4000), random.normal(10.0 * (1.0 + margin), 0.5, 4000)
    ends = np.asarray([fieller_interval(s, f, 0.25, 1.0, quantile) for s, f in zip(simulated, fields, strict=True)])
    for outside in (ends[:, 1] < margin, ends[:, 0] > margin):
        assert np.mean(outside) == pytest.approx(0.05, abs=0.011)


def test_a_field_that_may_be_nothing_has_no_ratio():
    assert np.isnan(fieller_interval(3.0, 1.0, 0.1, 1.0, 1.645)).all()
    assert fieller_interval(11.0, 10.0, 0.0, 0.0, 1.645) == pytest.approx((0.1, 0.1))


def test_what_one_round_alone_shows_is_not_known_to_differ():
    """Of a quantity that a single drive or round shows, each draw has the same value or none."""
    random = np.random.default_rng(8)
    field, rounds = observed(random, 20.0, 8), observed(random, 40.0, 12, 8)
    seen_once = field.tally.copy()
    seen_once[1:] = 0.0
    lonely = ObservedDrives(seen_once, {}, np.zeros((8, 1)))
    alone = ObservedDrives(rounds.tally * (np.arange(12) == 3)[:, None, None], {}, np.zeros(0))
    for one, other in ((lonely, rounds), (field, alone)):
        found = compare_within_margins(MEASURES, dict.fromkeys(Moe, Margin(0.1, "here")), NAMES, one, other, random)
        assert found["traffic_speed_mps"]["verdict"] == OPEN
        assert found["traffic_speed_mps"]["interval_90"] is None
