"""What is said of drives whose log and departure do not go together."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.problem.drive_warnings import departure_warnings, length_warnings, one_sided_warnings


def drive(begin_s: float, begin_m: float, speed_mps: float = 25.0) -> Any:
    time_s = begin_s + np.arange(0.0, 60.0, 0.5)
    subject = SimpleNamespace(
        time_s=time_s, position_m=begin_m + speed_mps * (time_s - begin_s), speed_mps=np.full(len(time_s), speed_mps)
    )
    return SimpleNamespace(id="d01", subject=subject)


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
