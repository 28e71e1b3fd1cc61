"""The search for place and time around the first windows, on made-up signatures."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window
from jaxcalib.diagnosis.inference.atlas import EffectTrial
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.place_search import SHORTEST_M, SHORTEST_S, neighbours, refine_places
from jaxcalib.diagnosis.runs.trials import BASELINE
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null()
SIZE = len(NULL.cells)
TRUTH = Window(1300.0, 1700.0, 400.0, 480.0)
FIRST = Window(1200.0, 1700.0, 360.0, 480.0)
NUM_RUNS = 6


def pattern(window: Window) -> np.ndarray:
    """Return what slow drivers in a window do to made-up features: a stretch and a period each belong to one."""
    assert window.from_s is not None
    assert window.to_s is not None
    place, time = np.linspace(0.0, 3000.0, SIZE), np.linspace(700.0, 200.0, SIZE)
    at_place = np.clip((np.minimum(window.to_m, place + 150.0) - np.maximum(window.from_m, place)) / 150.0, 0.0, 1.0)
    at_time = np.clip((np.minimum(window.to_s, time + 25.0) - np.maximum(window.from_s, time)) / 25.0, 0.0, 1.0)
    return -6.0 * (at_place + at_time)


def tallies(window: Window | None) -> DriveTallies:
    shift = np.zeros(SIZE) if window is None else pattern(window)
    above = np.tile(NULL.mean + NULL.deviation * shift, (NUM_RUNS, 1))
    above = above + 1e-3 * np.random.default_rng(2).standard_normal(above.shape)
    return DriveTallies(NULL.cells, above, np.ones_like(above), np.zeros(NUM_RUNS))


def run(trials: Sequence[EffectTrial]) -> Mapping[str, DriveTallies]:
    return {BASELINE: tallies(None)} | {one.trial.name: tallies(one.window) for one in trials}


def overlap(one: Window, other: Window) -> float:
    def share(a: float, b: float, c: float, d: float) -> float:
        return max(0.0, min(b, d) - max(a, c)) / (max(b, d) - min(a, c))

    times = [time for window in (one, other) for time in (window.from_s, window.to_s)]
    return share(one.from_m, one.to_m, other.from_m, other.to_m) * share(*(float(time or 0.0) for time in times))


def test_steps_lead_nearer_to_where_it_is():
    first = Signature(
        "rubbernecking", FIRST.setting(), np.asarray([0.0, 0.4]), np.stack([np.zeros(SIZE), pattern(FIRST)]),
        np.zeros((2, SIZE)),
    )  # fmt: skip
    explained = [Explained("rubbernecking", 30.0, 0.4, (0.3, 0.5), FIRST.setting(), 50.0, pattern(FIRST))]
    found = refine_places(
        pattern(TRUTH), NULL, np.zeros(SIZE), explained, {"rubbernecking": [first]}, np.asarray([4000.0, 500.0]),
        NUM_RUNS, (1, 2), run,
    )  # fmt: skip
    setting = found["rubbernecking"][-1].setting
    assert found["rubbernecking"][0] is first
    better = Window(setting["route_from_m"], setting["route_to_m"], setting["time_from_s"], setting["time_to_s"])
    assert overlap(better, TRUTH) > overlap(FIRST, TRUTH) + 0.1


def test_what_has_no_place_is_left_alone():
    memory = Signature("memory", {}, np.asarray([0.0, 0.5]), np.ones((2, SIZE)), np.zeros((2, SIZE)))
    explained = [Explained("memory", 30.0, 0.5, (0.3, 0.6), {}, 50.0, np.ones(SIZE))]
    arguments = (np.ones(SIZE), NULL, np.zeros(SIZE), explained, {"memory": [memory]}, np.ones(2), NUM_RUNS, (1, 2))
    found = refine_places(*arguments, lambda trials: pytest.fail("nothing is to be run"))
    assert found == {"memory": [memory]}


@given(
    begin_m=st.floats(0.0, 2000.0), length_m=st.floats(100.0, 900.0), begin_s=st.floats(0.0, 500.0),
    length_s=st.floats(30.0, 300.0), step_m=st.floats(10.0, 200.0), step_s=st.floats(5.0, 60.0),
)  # fmt: skip
def test_neighbours_are_windows(
    begin_m: float, length_m: float, begin_s: float, length_s: float, step_m: float, step_s: float
):
    window = Window(begin_m, begin_m + length_m, begin_s, begin_s + length_s)
    for one in neighbours(window, step_m, step_s, ()):
        assert one.from_s is not None
        assert one.to_s is not None
        assert one.from_m >= 0.0
        assert one.from_s >= 0.0
        assert one.to_m - one.from_m >= SHORTEST_M - 1e-9
        assert one.to_s - one.from_s >= SHORTEST_S - 1e-9
        assert one != window


def test_a_point_stays_a_point_and_tries_other_lanes():
    found = neighbours(Window(900.0, 900.0, 300.0, 400.0, 2), 50.0, 20.0, (1, 2, 3))
    assert all(one.from_m == one.to_m for one in found)
    assert {one.lane for one in found} == {1, 2, 3}
