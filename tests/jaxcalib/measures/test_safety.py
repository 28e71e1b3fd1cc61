"""Surrogate safety measures: worked out by hand, and against a simulation of braking vehicles."""

import dataclasses
from collections.abc import Callable, Mapping

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits
from jaxcalib.measures.drive_tally import DriveTally
from jaxcalib.measures.measure import Measure, MeasureValue
from jaxcalib.measures.registry import all_measures, safety_measures
from jaxcalib.measures.safety import DRAC_BORDER_MPS2, braking_needed
from jaxcalib.measures.whole_drive import WholeDriveFold
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.conftest import NUM_FRAMES
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], dict[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]
LENGTH_M = 4.5


def approach(gap_m: float, speed_mps: float, leader_mps: float, before_mps: float | None = None) -> PerceptionFrame:
    """The subject vehicle closes in on track 0; half a second before it had another speed."""
    before = speed_mps if before_mps is None else before_mps
    return drive(
        instant(7.0, Car(EGO, 1, 400.0, before), Car(0, 1, 430.0, leader_mps), Car(1, 1, 300.0, 15.0)),
        instant(
            7.5,
            Car(EGO, 1, 410.0, speed_mps),
            Car(0, 1, 410.0 + gap_m + LENGTH_M, leader_mps),
            Car(1, 1, 351.0, 15.0),
        ),
    )


@pytest.mark.parametrize(
    ("gap_m", "exposed", "shortfall_s"),
    [(20.0, 0.0, 0.0), (11.0, 1.0, USUAL_LIMITS.ttc_s - 11.0 / 4.0), (5.0, 1.0, USUAL_LIMITS.ttc_s - 5.0 / 4.0)],
)
def test_time_to_collision(measure: MeasureOf, gap_m: float, exposed: float, shortfall_s: float):
    """4 m/s faster than the leader; the first frame, before which nothing was seen, does not count."""
    frames = approach(gap_m, 22.0, 18.0)
    assert measure(frames, "subject_ttc_exposed_share").value == pytest.approx(exposed)
    assert measure(frames, "subject_ttc_integral_s").value == pytest.approx(shortfall_s, abs=1e-5)
    found = measure(frames, "background_ttc_exposed_share")
    assert (found.value, found.num_observations) == (0.0, 0.0)  # slower than the subject vehicle ahead


def test_who_does_not_close_in_is_exposed_to_nothing(measure: MeasureOf, count: Count):
    frames = approach(3.0, 18.0, 18.0)
    assert measure(frames, "subject_ttc_exposed_share").value == 0.0
    assert not measure(frames, "subject_ttc_p05_s").is_valid
    assert count(frames)["subject_behind_leader_s"] == 0.5


def test_deceleration_to_avoid_a_crash_and_near_misses(measure: MeasureOf):
    near, far = approach(4.0, 24.0, 18.0), approach(6.0, 24.0, 18.0)  # 36 / 8 = 4.5 and 36 / 12 = 3 m/s^2
    assert measure(near, "subject_drac_exposed_share").value == 1.0
    assert measure(far, "subject_drac_exposed_share").value == 0.0
    # half a second at 24 m/s: 12 m
    assert measure(near, "subject_near_miss_s_p1000km").value == pytest.approx(0.5 / 12.0 * 1e6)
    assert measure(far, "subject_near_miss_s_p1000km").value == 0.0


def test_a_near_miss_needs_little_time_and_much_braking(measure: MeasureOf):
    """Fast from afar much braking is needed, and there is time; slowly from near there is neither."""
    far, slow = approach(50.0, 42.0, 18.0), approach(1.0, 18.9, 18.0)  # 5.8 m/s^2 in 2.1 s; 0.4 m/s^2 in 1.1 s
    assert measure(far, "subject_drac_exposed_share").value == 1.0
    assert measure(far, "subject_near_miss_s_p1000km").value == 0.0
    assert measure(slow, "subject_drac_exposed_share").value == 0.0
    assert measure(slow, "subject_near_miss_s_p1000km").value == 0.0


@pytest.mark.parametrize(("braking_mps", "exposed"), [(0.0, 0.0), (4.0, 1.0)])
def test_a_leader_who_brakes_threatens_who_does_not_close_in(measure: MeasureOf, braking_mps: float, exposed: float):
    """5 m behind a leader as fast as oneself: who brakes with 8 m/s^2 asks for more than the limit."""
    frames = drive(
        instant(7.0, Car(EGO, 1, 400.0, 20.0), Car(0, 1, 409.5, 20.0 + braking_mps)),
        instant(7.5, Car(EGO, 1, 410.0, 20.0), Car(0, 1, 419.5, 20.0)),
    )
    found = measure(frames, "subject_threat_exposed_share")
    assert found.value == exposed
    assert found.num_observations == 0.5 * exposed


def test_each_approach_is_in_one_class_of_deceleration(count: Count):
    """16 / 18 = 0.89 m/s^2, and 36 / 8 = 4.5 m/s^2."""
    for frames, index in ((approach(9.0, 22.0, 18.0), 7), (approach(4.0, 24.0, 18.0), 12)):
        counted = count(frames)
        bins = [counted[f"subject_approach_bin[{k}]"] for k in range(len(DRAC_BORDER_MPS2) - 1)]
        assert bins == [float(k == index) for k in range(len(bins))]
        low, high = DRAC_BORDER_MPS2[index : index + 2]
        assert low <= (16.0 / 18.0 if index == 7 else 4.5) < high


def test_an_approach_counts_once_by_its_hardest_moment(count: Count):
    """Needed: 0.89, 4.5 and 0.19 m/s^2 in one approach; 0 while the gap opens; then 0.89 m/s^2 again."""
    moments = [(9.0, 22.0), (9.0, 22.0), (4.0, 24.0), (42.0, 22.0), (42.0, 17.0), (9.0, 22.0)]
    frames = drive(
        *(
            instant(7.0 + 0.5 * k, Car(EGO, 1, 400.0 + 10 * k, mps), Car(0, 1, 400.0 + 10 * k + gap + LENGTH_M, 18.0))
            for k, (gap, mps) in enumerate(moments)
        )
    )
    counted = count(frames)
    bins = {k: counted[f"subject_approach_bin[{k}]"] for k in range(len(DRAC_BORDER_MPS2) - 1)}
    assert {k: number for k, number in bins.items() if number} == {12: 1.0, 7: 1.0}


def test_the_hardest_approach_of_all_is_not_lost(count: Count):
    """Nominal lengths overlap at the end: 20 m/s on 0.1 m need 2000 m/s^2, more than any class begins with."""
    moments = [(40.0, 38.0), (40.0, 38.0), (0.0, 38.0)]
    frames = drive(
        *(
            instant(7.0 + 0.5 * k, Car(EGO, 1, 400.0 + 10 * k, mps), Car(0, 1, 400.0 + 10 * k + gap + LENGTH_M, 18.0))
            for k, (gap, mps) in enumerate(moments)
        )
    )
    counted = count(frames)
    assert [counted[f"subject_approach_bin[{k}]"] for k in range(len(DRAC_BORDER_MPS2) - 1)] == [0.0] * 12 + [1.0]


def test_hard_braking(measure: MeasureOf):
    hard, soft = approach(60.0, 18.0, 18.0, before_mps=19.6), approach(60.0, 18.0, 18.0, before_mps=19.4)
    assert measure(hard, "subject_hard_braking_s_pkm").value == pytest.approx(0.5 / 9.0 * 1000.0)
    assert measure(soft, "subject_hard_braking_s_pkm").value == 0.0


def test_a_cut_in_leaves_a_time_gap_and_asks_for_a_deceleration(measure: MeasureOf):
    frames = drive(
        instant(1.0, Car(EGO, 1, 400.0, 25.0), Car(0, 0, 420.0, 20.0)),
        instant(1.5, Car(EGO, 1, 412.5, 25.0), Car(0, 1, 430.0, 20.0)),
    )
    gap_m = 430.0 - 412.5 - LENGTH_M
    assert measure(frames, "cut_in_time_gap_s").value == pytest.approx(gap_m / 25.0)
    assert measure(frames, "cut_in_drac_mps2").value == pytest.approx(5.0**2 / (2.0 * gap_m), rel=1e-5)
    assert measure(frames, "cut_in_time_gap_s").num_observations == 1


def test_percentiles_are_of_closing_gaps_alone(measure: MeasureOf):
    found = measure(approach(10.0, 22.0, 18.0), "subject_ttc_p15_s")  # 2.5 s, in the class from 2 to 3 s
    assert found.num_observations == 1
    assert 2.0 <= found.value <= 3.0


def collides(gap_m: float, speed: float, leader: float, leader_braking: float, braking: float) -> bool:
    """Whether two vehicles that brake evenly until they stand meet."""
    time_s = np.arange(0.0, 300.0, 2e-3)

    def way_m(begin: float, deceleration: float) -> np.ndarray:
        stands_s = begin / deceleration if deceleration > 0 else np.inf
        until = np.minimum(time_s, stands_s)
        return begin * until - 0.5 * deceleration * until**2

    return bool(np.any(way_m(speed, braking) - way_m(leader, leader_braking) > gap_m + 1e-3))


@pytest.mark.parametrize("seed", range(40))
def test_the_brake_threat_number_is_what_just_avoids_a_crash(seed: int):
    random = np.random.default_rng(seed)
    gap_m, speed, leader = random.uniform(2.0, 60.0), random.uniform(1.0, 35.0), random.uniform(0.5, 35.0)
    braking = random.choice([0.0, random.uniform(0.5, 7.0)])
    number = braking_needed(*(jnp.asarray([value]) for value in (gap_m, speed, leader, -braking)))
    needed = float(number[0])
    assert not collides(gap_m, speed, leader, braking, 1.02 * needed)
    if needed > 0.05:
        assert collides(gap_m, speed, leader, braking, 0.97 * needed)


def test_none_of_it_is_fitted(measures: Mapping[str, Measure]):
    assert set(safety_measures()) < set(measures)
    assert not any(measures[name].is_matched for name in safety_measures())


def test_a_case_may_state_its_own_limits(tally: DriveTally):
    limits = USUAL_LIMITS._replace(hard_braking_mps2=2.0)
    settings = dataclasses.replace(tally.settings, limits=SafetyLimits(*(jnp.asarray(limit) for limit in limits)))
    harder = approach(60.0, 18.0, 18.0, before_mps=19.2)  # 2.4 m/s^2
    measures = all_measures(settings)
    assert measures["subject_hard_braking_s_pkm"].description.startswith("time with more than 2 m/s^2")
    counted = [
        dict(zip(each.names, WholeDriveFold(each, NUM_FRAMES)(harder).tolist(), strict=True))["subject_hard_braking_s"]
        for each in (tally, DriveTally(settings, tally.folds))
    ]
    assert counted == [0.0, 0.5]
