"""What the study of inflows says of errors and bounds."""

import pytest

from experiments.inflows.__main__ import summary_of


def row(error: float, bound: float, scenario: float = 0.1) -> dict[str, float]:
    return {"found / truth - 1": error, "error / bound": error / bound, "scenario / truth - 1": scenario}


def test_the_summary_weighs_each_input_by_what_the_drives_hold() -> None:
    first, second = summary_of([row(0.03, 0.03), row(-0.3, 0.1, -0.3)])
    assert "root mean square: 2.24" in first  # of 1 and 3
    assert "median of sizes 2.00 (2 of 2 inputs" in first
    assert second.startswith("error of an inflow, mean of sizes 16.5%, largest 30.0%")
    assert second.endswith("of the scenario as it is 20.0%")


def test_an_input_that_the_drives_say_nothing_of_is_left_out() -> None:
    first, _ = summary_of([row(0.03, 0.03), {**row(0.5, 1.0), "error / bound": float("nan")}])
    assert "root mean square: 1.00" in first
    assert "(1 of 2 inputs" in first


@pytest.mark.parametrize("bound", [0.02, 0.2])
def test_an_error_as_large_as_the_bound_counts_one(bound: float) -> None:
    assert "root mean square: 1.00" in summary_of([row(bound, bound)])[0]
