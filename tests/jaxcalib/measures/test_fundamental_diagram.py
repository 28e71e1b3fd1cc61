"""The fundamental diagram by section, worked out by hand, and against the flow of all frames."""

import itertools
from collections.abc import Callable, Mapping

import pytest

from jaxcalib.measures.fundamental_diagram import LEVELS, PARTS
from jaxcalib.measures.measure import MeasureValue
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant, random_drive

Count = Callable[[PerceptionFrame], Mapping[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]


def crowd(number: int, speed_mps: float, at_m: float = 600.0) -> PerceptionFrame:
    """Sensors see 160 m of two lanes: 320 m of lane with as many vehicles, the subject vehicle included."""
    others = (Car(track, 1, at_m - 50.0 + 20.0 * track, speed_mps) for track in range(number - 1))
    return instant(3.0, Car(EGO, 0, at_m, speed_mps), *others)


@pytest.mark.parametrize(("number", "level"), [(3, "ab"), (4, "cd"), (7, "cd")])
def test_a_frame_counts_at_its_density(measure: MeasureOf, number: int, level: str):
    """3 in 320 m are 9.4 vehicles per km and lane, 4 are 12.5 and 7 are 21.9: from 11 to 22 lie C and D."""
    frames = drive(crowd(number, 21.0))
    density = 1000.0 * number / 320.0
    found = measure(frames, f"section_1_level_{level}_volume_vehph")
    assert found.value == pytest.approx(density * 21.0 * 3.6)
    assert found.num_observations == number
    assert measure(frames, f"section_1_level_{level}_speed_mps").value == pytest.approx(21.0)
    for other in set(LEVELS) - {level}:
        assert not measure(frames, f"section_1_level_{other}_volume_vehph").is_valid


def test_a_jam_is_a_point_of_its_own(measure: MeasureOf):
    """8 in 320 m are 25 per km and lane, level E; 80 m before the road's end 8 in 280 m are 28.6, beyond capacity."""
    frames = drive(crowd(8, 14.0), crowd(3, 30.0))
    assert measure(frames, "section_1_level_e_speed_mps").value == pytest.approx(14.0)
    assert measure(frames, "section_1_level_ab_speed_mps").value == pytest.approx(30.0)
    near_the_end = drive(crowd(8, 6.0, at_m=920.0))
    assert measure(near_the_end, "section_1_level_f_speed_mps").value == pytest.approx(6.0)


def test_a_glance_at_a_section_says_nothing(count: Count):
    """At 345 m the sensors see 45 m of section 1, and from 285 to 400 m of section 0."""
    counted = count(drive(instant(3.0, Car(EGO, 0, 345.0, 20.0), Car(0, 1, 420.0, 20.0))))
    assert sum(counted[f"level_{level}_lane_m[1]"] for level in LEVELS) == 0.0
    assert sum(counted[f"level_{level}_lane_m[0]"] for level in LEVELS) == pytest.approx(2 * 115.0 + 100.0)


def test_levels_add_up_to_the_section_where_every_frame_sees_enough_of_it(count: Count):
    num_equal = 0
    for seed, section in itertools.product(range(8), range(2)):
        counted = count(random_drive(seed))
        of_levels = [sum(counted[f"level_{level}_{part}[{section}]"] for level in LEVELS) for part in PARTS]
        whole = [counted[f"section_{name}[{section}]"] for name in ("lane_m", "frames", "speed")]
        assert all(part <= total + 1e-3 for part, total in zip(of_levels, whole, strict=True))
        if of_levels[0] == pytest.approx(whole[0]) and whole[1] > 0.0:
            assert of_levels == pytest.approx(whole, rel=1e-5)
            num_equal += 1
    assert num_equal >= 3
