"""A result says where held-out drives agree less with calibrated values than with the scenario's."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import pytest

from jaxcalib.calibration.confirmation.final_errors import FinalErrors
from jaxcalib.calibration.objective.accuracy import TRAFFIC_LEVEL, VEHICLE_LEVEL, VEHICLE_LEVEL_SUM, Effectiveness
from jaxcalib.calibration.result.error_tables import ErrorsByRole, effectiveness_table, held_out_warnings

Errors = Mapping[str, float | None]
BEFORE = dict.fromkeys(VEHICLE_LEVEL, 0.2) | dict.fromkeys(TRAFFIC_LEVEL, 0.1)
HIGH = dict.fromkeys(TRAFFIC_LEVEL, 0.16) | {VEHICLE_LEVEL_SUM: 1.2}


def final_errors(errors: Errors, high: Errors | None = None) -> FinalErrors:
    nothing: Any = None
    return FinalErrors(6, Effectiveness(errors, {}), nothing, nothing, {}, 0.7, dict(high or {}))


def errors_of(after: Errors, role: str = "held_out") -> ErrorsByRole:
    before, now = final_errors(BEFORE), final_errors(BEFORE | dict(after), HIGH)
    missing = cast(FinalErrors | None, None)
    return {
        "no_calibration": {"fit": before, "held_out": missing} | {role: before},
        "calibrated": {"fit": now, "held_out": missing} | {role: now},
    }


@pytest.mark.parametrize(
    ("after", "said"),
    [
        ({}, []),
        ({"cut_ins": 1.1}, [("single vehicles", 1.9, 1.0, 1.2)]),
        ({"cut_ins": 0.35}, []),  # more than before, no more than chance
        (dict.fromkeys(TRAFFIC_LEVEL, 0.3), [("the traffic flow", 0.3, 0.1, 0.16)]),
        ({TRAFFIC_LEVEL[0]: 0.3}, []),  # one of four, whose mean chance explains
        (
            {"cut_ins": 1.1} | dict.fromkeys(TRAFFIC_LEVEL, 0.3),
            [("single vehicles", 1.9, 1.0, 1.2), ("the traffic flow", 0.3, 0.1, 0.16)],
        ),
    ],
)
def test_what_is_worse_than_before_and_than_chance_is_said(after: Errors, said: list[tuple[str, float, float, float]]):
    found = held_out_warnings(errors_of(after))
    assert len(found) == len(said)
    for line, (level, *numbers) in zip(found, said, strict=True):
        assert level in line
        assert [float(number) for number in re.findall(r"\d+\.\d+", line)] == pytest.approx(numbers)


def test_what_was_bad_before_and_is_better_is_no_warning():
    errors = errors_of({"cut_ins": 1.1})
    errors["no_calibration"]["held_out"] = final_errors(BEFORE | {"cut_ins": 3.0})
    assert held_out_warnings(errors) == []


def test_where_chance_has_no_error_none_is_explained_by_it():
    errors = errors_of({TRAFFIC_LEVEL[0]: 0.5})
    errors["calibrated"]["held_out"] = final_errors(
        BEFORE | {TRAFFIC_LEVEL[0]: 0.5}, HIGH | dict.fromkeys(TRAFFIC_LEVEL, 0.0)
    )
    (line,) = held_out_warnings(errors)
    assert [float(number) for number in re.findall(r"\d+\.\d+", line)] == pytest.approx([0.2, 0.1, 0.0])


def test_without_held_out_drives_nothing_is_said():
    assert held_out_warnings(errors_of({"cut_ins": 5.0}, role="fit")) == []


def test_errors_that_are_not_known_count_for_nothing():
    unknown = dict.fromkeys(TRAFFIC_LEVEL[1:]) | {TRAFFIC_LEVEL[0]: 0.4}
    (line,) = held_out_warnings(errors_of(unknown))
    assert [float(number) for number in re.findall(r"\d+\.\d+", line)] == pytest.approx([0.4, 0.1, 0.16])


def test_what_drives_do_not_show_has_no_noise_floor():
    errors = errors_of({"cut_ins": None, "traffic_speed": float("nan")})
    now = errors["calibrated"]["held_out"]
    assert now is not None
    errors["calibrated"]["held_out"] = replace(now, floor=dict.fromkeys(now.pooled.errors, 0.3))
    errors["calibrated"]["fit"] = None
    floor = effectiveness_table(errors, {})["noise_floor"]["held_out"]
    assert {name for name, error in floor.items() if error is None} == {"cut_ins", "traffic_speed"}
    assert floor["traffic_volume"] == 0.3
