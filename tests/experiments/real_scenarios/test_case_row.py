"""A case's row: what its result says, and when it counts as better."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.real_scenarios.__main__ import shares, table_of
from experiments.real_scenarios.case_row import TRAFFIC_LEVEL_MEAN, CaseRow, read_row, run_case
from jaxcalib.calibration.objective.accuracy import TRAFFIC_LEVEL, VEHICLE_LEVEL_SUM

AGREEMENT = {"where": "at the scenario's values", "share_alike": 0.5, "holds": False}


def result(before: float, after: float, high: float, in_sumo: bool = False, share_alike: float = 1.0) -> dict[str, Any]:
    """Return the parts of result.json that a row is made of; one error of the traffic level is not known."""
    traffic = {name: 0.1 * place for place, name in enumerate(TRAFFIC_LEVEL, 1)}
    unknown = {TRAFFIC_LEVEL[-1]: None}
    return {
        "moes": {
            "no_calibration": {"held_out": {name: 2.0 * error for name, error in traffic.items()} | unknown},
            "calibrated": {"held_out": traffic},
            "noise_floor": {"held_out": {name: 0.05 for name in traffic}},
        },
        "noise_floor_high": {"held_out": {name: 0.07 for name in traffic}},
        "vehicle_level_error": {
            "no_calibration": {"held_out": {"value": before}},
            "calibrated": {"held_out": {"value": after}},
            "noise_floor": {"held_out": {"value": 0.5 * high, "quantile_95": high}},
        },
        "wall_s": {"total": 73.0},
        "confirmation": {
            "searched_in_sumo": in_sumo,
            "agreement": [AGREEMENT | {"share_alike": share_alike, "holds": share_alike >= 0.9}],
        },
    }


@pytest.mark.parametrize(
    ("before", "after", "high", "is_better"),
    [(1.0, 0.9, 0.1, True), (0.3, 0.35, 0.4, True), (0.3, 0.35, 0.34, False)],
)
def test_an_error_is_better_if_lower_or_at_its_noise_floor(before: float, after: float, high: float, is_better: bool):
    row = read_row("bremen", result(before, after, high), 1.5, [])
    assert row.is_better(VEHICLE_LEVEL_SUM) is is_better
    assert row.errors is not None
    assert row.errors[VEHICLE_LEVEL_SUM] == (before, after, 0.5 * high, high)


def test_traffic_errors_count_in_the_mean_of_those_that_all_have() -> None:
    row = read_row("bremen", result(1.0, 0.5, 0.2), 1.5, [])
    assert row.errors is not None
    before, after, floor, high = row.errors[TRAFFIC_LEVEL_MEAN]
    known = len(TRAFFIC_LEVEL) - 1
    assert after == pytest.approx(0.1 * (known + 1) / 2.0)
    assert before == pytest.approx(2.0 * after)
    assert (floor, high) == pytest.approx((0.05, 0.07))


@pytest.mark.parametrize(
    ("in_sumo", "share_alike", "reasons", "words", "is_right"),
    [
        (False, 1.0, [], "", True),
        (False, 0.5, [], "50% of sections alike at the scenario's values", False),
        (True, 0.5, [], "50% of sections alike at the scenario's values", True),
        (True, 1.0, ["net.xml: a roundabout"], "net.xml: a roundabout", True),
    ],
)
def test_the_surrogate_drives_alike_or_sumo_runs_alone_and_says_why(
    in_sumo: bool, share_alike: float, reasons: list[str], words: str, is_right: bool
):
    row = read_row("bremen", result(1.0, 0.5, 0.2, in_sumo, share_alike), 1.5, reasons)
    assert row.words == words
    assert row.is_followed_or_left is is_right


def test_shares_count_what_ended_and_all_cases() -> None:
    good = read_row("a", result(1.0, 0.5, 0.2), 1.5, [])
    worse = replace(read_row("b", result(0.3, 0.5, 0.2), 1.5, []), share_alike=0.2)
    refused = CaseRow("c", "refused", "net.xml: nothing there", 0.5)
    told = shares([good, worse, refused])
    assert list(told.values()) == ["2 of 3", "1 of 2", "2 of 2", "1 of 2", "1 of 2"]
    cells = table_of([good, worse, refused])
    assert cells[2]["why"] == "net.xml: nothing there"
    assert all(list(row) == list(cells[0]) for row in cells)


def test_a_folder_that_is_no_case_is_a_row_that_says_so(tmp_path: Path) -> None:
    row = run_case(tmp_path / "nothing", tmp_path, 1.0)
    assert row.ending == "refused"
    assert "case.toml" in row.words


def test_sections_count_where_the_search_begins() -> None:
    begun = result(1.0, 0.5, 0.2)
    agreement = [AGREEMENT, {"where": "with the drivers that the logs show", "share_alike": 0.95, "holds": True}]
    begun["confirmation"]["agreement"] = agreement
    row = read_row("onramp", begun, 1.5, [])
    assert row.is_followed_or_left
    assert "50% of sections alike at the scenario's values" in row.words
