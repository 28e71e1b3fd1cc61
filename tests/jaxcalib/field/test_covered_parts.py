"""Which parts of the route a log covers."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.field.covered_parts import coverage_warnings, covered_m, covered_parts_m, recorded_parts
from sim_adapters.scenario.demand_elements import Departure
from sim_adapters.world.recorded_parts import WHOLE_M

LENGTH_M = 3000.0


def log(begin_m: float, end_m: float, name: str = "d01", begin_s: float = 600.0, speed_mps: float = 25.0) -> Any:
    time_s = begin_s + np.arange(0.0, (end_m - begin_m) / speed_mps + 0.25, 0.5)
    subject = SimpleNamespace(time_s=time_s, position_m=begin_m + speed_mps * (time_s - begin_s))
    return SimpleNamespace(id=name, subject=subject, rules=SimpleNamespace(longest_gap_s=1.0))


def without(one: Any, from_s: float, to_s: float) -> Any:
    kept = (one.subject.time_s <= from_s) | (one.subject.time_s >= to_s)
    one.subject.time_s, one.subject.position_m = one.subject.time_s[kept], one.subject.position_m[kept]
    return one


def scenario(position: str) -> Any:
    demand = SimpleNamespace(subject_departure=Departure(position=position))
    return SimpleNamespace(network=SimpleNamespace(length_m=LENGTH_M), demand=demand)


def test_a_log_from_one_end_to_the_other_is_whole():
    """What is missing at both ends may be what a vehicle drives between two samples."""
    assert covered_parts_m(log(4.0, 2995.0), LENGTH_M) == WHOLE_M
    assert covered_parts_m(log(55.0, 2945.0), LENGTH_M) == WHOLE_M


def test_a_log_of_a_part_ends_where_it_ends():
    assert covered_parts_m(log(0.0, 1500.0), LENGTH_M) == ((-np.inf, 1500.0),)
    assert covered_parts_m(log(800.0, 2990.0), LENGTH_M) == ((800.0, np.inf),)
    assert covered_parts_m(log(800.0, 1800.0), LENGTH_M) == ((800.0, 1800.0),)


def test_gaps_part_a_log_where_the_vehicle_moves():
    one = without(log(0.0, 2990.0), 620.0, 650.0)
    assert covered_parts_m(one, LENGTH_M) == ((-np.inf, 500.0), (1250.0, np.inf))
    assert covered_m(covered_parts_m(one, LENGTH_M), LENGTH_M) == 2250.0
    one.rules.longest_gap_s = 30.0
    assert covered_parts_m(one, LENGTH_M) == WHOLE_M
    standing = without(log(0.0, 2990.0), 620.0, 650.0)
    standing.subject.position_m[standing.subject.time_s >= 650.0] -= 749.5
    assert covered_parts_m(standing, 2240.0) == WHOLE_M


@pytest.mark.parametrize(
    ("begin_s", "position", "begin_m"),
    [
        (600.2, "last", -np.inf),
        (600.2, "base", 102.0),
        (600.2, "10", 102.0),
        (605.0, "last", 102.0),
        (600.2, "90", -np.inf),
        (600.2, "-90", -np.inf),
    ],
)
def test_who_enters_anywhere_may_have_entered_there(begin_s: float, position: str, begin_m: float):
    """102 m take a vehicle from the route's begin some seconds, unless it was put there."""
    drives: Any = [SimpleNamespace(depart_s=600.0)] * 2
    first, second = recorded_parts(drives, [log(102.0, 2990.0, begin_s=begin_s), log(0.0, 900.0)], scenario(position))
    assert first.parts_m == ((begin_m, np.inf),)
    assert second.parts_m == ((-np.inf, 900.0),)


def test_whole_logs_leave_nothing_to_tell_simulators():
    drives: Any = [SimpleNamespace(depart_s=600.0)]
    assert recorded_parts(drives, [log(9.0, 2980.0)], scenario("base")) == ()
    assert coverage_warnings((), [log(9.0, 2980.0)], LENGTH_M) == []


def test_a_part_is_told():
    drives: Any = [SimpleNamespace(depart_s=600.0)] * 3
    logs = [log(9.0, 2980.0), log(0.0, 1500.0, "d02"), without(log(0.0, 2990.0, "d03"), 620.0, 650.0)]
    of_part, of_gap = coverage_warnings(recorded_parts(drives, logs, scenario("base")), logs, LENGTH_M)
    assert of_part.startswith(
        "drive d02: the log covers 1500 of 3000 m of the route; it is compared with the same part"
    )
    short = [without(log(0.0, 2990.0), 620.0, 622.0)]
    assert recorded_parts(drives[:1], short, scenario("base"))[0].parts_m == ((-np.inf, 500.0), (550.0, np.inf))
    assert coverage_warnings(recorded_parts(drives[:1], short, scenario("base")), short, LENGTH_M) == []
    assert of_gap.startswith("drive d03: the log covers 2250 of 3000 m of the route, and 750 m lie in its gaps;")
