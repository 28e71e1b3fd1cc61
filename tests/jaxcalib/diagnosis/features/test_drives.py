"""Drives as tables, and what identities say of drives into which an effect was put."""

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import TallyBook
from jaxcalib.diagnosis.features.identities import count_identities
from jaxcalib.diagnosis.runs.null_runs import alterations_of
from surrogate.effects.recorded_drives import alter_drive
from surrogate.effects.registry import effect_named
from tests.jaxcalib.diagnosis.synthetic import ROAD, STEP_S, two_vehicles


def identities(table) -> dict[tuple[str, str, str], float]:
    book = TallyBook()
    count_identities(table, ROAD, book)
    return {(c.measure, c.regime, c.role): above / below for c, (above, below) in book.sums.items() if below}


def altered(name: str, strength: float):
    return alter_drive(two_vehicles(), effect_named(name), strength, ROAD.log, np.random.default_rng(3))


def test_links_of_a_table():
    table = two_vehicles(5)
    assert (table.leader == -1).all()  # each is alone in its lane
    assert table.after.tolist() == [2, 3, 4, 5, 6, 7, 8, 9, -1, -1]
    assert table.later(-3).tolist() == [-1] * 6 + [0, 1, 2, 3]
    event = np.zeros(10, bool)
    event[[1, 4]] = True
    since = table.since(event)
    assert since[1::2] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert since[0::2] == pytest.approx([np.inf, np.inf, 0.0, 0.1, 0.2])
    values = np.arange(10.0)
    assert table.recent_mean(values, 2 * STEP_S)[1::2] == pytest.approx([1.0, 2.0, 3.0, 5.0, 7.0])


def test_coarser_table_keeps_the_multiples():
    table = two_vehicles(23)
    coarse = table.coarser(5)
    assert coarse.time_s == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0])
    assert coarse.instant.tolist() == np.repeat(np.arange(5), 2).tolist()
    assert coarse.position_m == pytest.approx(table.position_m[np.isin(table.instant, [0, 5, 10, 15, 20])])


@pytest.mark.parametrize("bias", [-0.04, 0.03, 0.11])
def test_scale_of_distances_is_read_from_motion(bias: float):
    found = identities(altered("gap_sensor_bias", bias))
    # the error is regressed on the true change of distance, of which the bias is a share; rounding leaves 1e-3
    assert found["distance_scale_error", "", "background"] == pytest.approx(bias, abs=2e-3)


def test_latency_is_read_from_own_changes_of_speed():
    usual, late = identities(two_vehicles()), identities(altered("sensor_latency", 0.4))
    cell = ("latency_by_own_change_s", "", "subject")
    assert usual[cell] == pytest.approx(0.0, abs=0.01)
    assert late[cell] == pytest.approx(0.4, abs=0.1)  # other vehicles' motion is not independent of one's own here


def test_noise_is_read_from_second_differences():
    found = identities(altered("sensor_noise", 0.3))
    # second difference of white noise: variance 6 sigma^2, successive ones correlate by -4/6
    square = found["second_difference_square_of_distance_m", "", "background"]
    assert square == pytest.approx(6 * 0.3**2, rel=0.2)
    assert found["second_difference_alternation_of_distance_m", "", "background"] == pytest.approx(-2 / 3, abs=0.08)


@pytest.mark.parametrize(("name", "role"), [("reaction_delay", "background"), ("subject_actuation_lag", "subject")])
def test_rhythm_of_acting_peaks_at_its_interval(name: str, role: str):
    found = identities(altered(name, 0.6))
    rhythm = {key[1]: value for key, value in found.items() if key[0] == "rhythm_of_acting" and key[2] == role}
    # multiples of the interval stand out alike; the interval is the first that does
    assert rhythm["0.6 s"] > 0.3
    assert max(rhythm[f"{0.1 * k:.1f} s"] for k in (2, 3, 4)) < 0.1


def test_short_range_takes_what_is_far_and_nothing_else():
    table, short = two_vehicles(), altered("sensor_range", 0.5)
    near = (table.offset_m <= 75.0) & (table.offset_m >= -60.0)
    assert len(short.instant) == near.sum()
    assert short.offset_m == pytest.approx(table.offset_m[near])


@pytest.mark.parametrize(("interval_s", "late_s"), [(0.1, [0.2, 0.4, 0.7]), (0.25, [0.25, 0.5, 0.75]), (0.5, [0.5])])
def test_a_log_is_late_by_its_own_steps(interval_s: float, late_s: list[float]):
    chosen = alterations_of(interval_s, 0.5)
    assert [strength for name, strength in chosen if name == "sensor_latency"] == pytest.approx(late_s)
    assert [strength for name, strength in chosen if name == "sensor_noise"] == [0.1, 0.3, 0.8]
    assert [strength for name, strength in chosen if name == "gap_sensor_bias"] == [0.02, 0.05, 0.12, -0.05, -0.12]
