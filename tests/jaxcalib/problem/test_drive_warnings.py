"""What is said of drives whose log and departure do not go together."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.problem.drive_warnings import (
    counted_in_parts,
    coverage_warnings,
    departure_warnings,
    length_warnings,
    one_sided_warnings,
)


def drive(begin_s: float, begin_m: float, speed_mps: float = 25.0) -> Any:
    time_s = begin_s + np.arange(0.0, 60.0, 0.5)
    subject = SimpleNamespace(
        time_s=time_s, position_m=begin_m + speed_mps * (time_s - begin_s), speed_mps=np.full(len(time_s), speed_mps)
    )
    return SimpleNamespace(id="d01", subject=subject, rules=SimpleNamespace(longest_gap_s=1.0))


CASE: Any = SimpleNamespace(drives=(SimpleNamespace(id="d01", depart_s=600.0),))


@pytest.mark.parametrize(("begin_s", "begin_m"), [(600.0, 0.0), (601.0, 30.0), (650.0, 40.0), (720.0, 2500.0)])
def test_logs_that_begin_where_the_vehicle_can_be_are_no_news(begin_s: float, begin_m: float):
    assert departure_warnings(CASE, [drive(begin_s, begin_m)]) == []


@pytest.mark.parametrize(("begin_s", "begin_m"), [(600.0, 4000.0), (760.0, 0.0), (4200.0, 100.0)])
def test_a_clock_that_is_another_shows(begin_s: float, begin_m: float):
    (line,) = departure_warnings(CASE, [drive(begin_s, begin_m)])
    assert line.startswith(f"drive d01: the log begins {begin_s - 600.0:.0f} s after depart_s at {begin_m:.0f} m")
    assert "scenario's clock?" in line


def test_who_crawls_says_nothing_of_the_way():
    assert departure_warnings(CASE, [drive(900.0, 100.0, 1.0)]) == []


def test_a_part_of_the_route_is_told():
    (line,) = coverage_warnings([drive(600.0, 0.0)], 3000.0)
    assert "covers 1488 of 3000 m" in line
    assert coverage_warnings([drive(600.0, 0.0)], 1600.0) == []


def test_a_part_of_the_route_counts_as_a_part_of_a_drive():
    """Twelve events in a third of the route are as many as 36 in all of it."""
    tally = np.asarray([[12.0, 1.0, 1.0], [36.0, 1.0, 1.0]])
    whole, third = drive(600.0, 0.0), drive(600.0, 800.0, 500.0 / 59.5)
    counted = counted_in_parts(tally, [third, whole], 1500.0, {"drives": 1, "trips": 2})
    assert counted[:, 0] / counted[:, 1] == pytest.approx([36.0, 36.0])
    assert counted[:, 2] == pytest.approx(counted[:, 1])
    assert tally[0, 1] == 1.0


def test_nothing_is_counted_in_a_gap_though_the_trip_goes_on():
    """Seen for 59.5 s less 24 s: 600 of 1488 m lie in the gap."""
    log, tally = drive(600.0, 0.0), np.asarray([[22.0, 1.0, 1.0]])
    kept = (log.subject.time_s <= 610.0) | (log.subject.time_s >= 634.0)
    log.subject.time_s, log.subject.position_m = log.subject.time_s[kept], log.subject.position_m[kept]
    (counted,) = counted_in_parts(tally, [log], 1500.0, {"drives": 1, "trips": 2})
    assert counted[1:] == pytest.approx([(1487.5 - 600.0) / 1500.0, 1.0])
    (line,) = coverage_warnings([log], 1500.0)
    assert "covers 888 of 1500 m of the route, and 600 m lie in its gaps" in line
    log.rules.longest_gap_s = 30.0
    assert coverage_warnings([log], 1500.0) == []


@pytest.mark.parametrize(
    ("reference", "length_m", "lacking", "warns"),
    [("near_end", 16.5, 40, True), ("near_end", 16.5, 0, False), ("near_end", 5.0, 40, False)],
)
def test_lengths_that_a_distance_needs_are_asked_for(reference: str, length_m: float, lacking: int, warns: bool):
    case: Any = SimpleNamespace(
        perception=SimpleNamespace(nominal_length_m=4.8), log_form=SimpleNamespace(reference=reference)
    )
    scenario: Any = SimpleNamespace(
        flows=[SimpleNamespace(vtype="car"), SimpleNamespace(vtype="truck")],
        values_of=lambda vtype: {"length": length_m if vtype == "truck" else 4.6},
    )
    logs: Any = [SimpleNamespace(id="d07", counts=SimpleNamespace(rows_without_length=lacking))]
    lines = length_warnings(case, scenario, logs)
    assert bool(lines) == warns
    assert all("logs of d07" in line and "'truck' of 16.5 m" in line for line in lines)


def test_sensors_that_look_one_way_are_told():
    case: Any = SimpleNamespace(perception=SimpleNamespace(ahead_m=150.0, behind_m=100.0))
    ahead_m = np.linspace(5.0, 140.0, 2000)
    both, ahead, few = (
        SimpleNamespace(id=name, objects=SimpleNamespace(offset_m=offset_m))
        for name, offset_m in (("both", np.append(ahead_m, -ahead_m)), ("ahead", ahead_m), ("few", ahead_m[:50]))
    )
    (line,) = one_sided_warnings(case, [both, ahead, few])  # pyright: ignore
    assert line.startswith("drive ahead: 0.0% of the objects are behind")
    case.perception.behind_m = 0.0
    assert one_sided_warnings(case, [ahead]) == []  # pyright: ignore
