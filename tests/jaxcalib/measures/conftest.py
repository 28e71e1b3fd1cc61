"""Lets the tests of this folder import its frames made by hand; one compiled fold that they share."""

from collections.abc import Callable, Mapping

import jax.numpy as jnp
import pytest

from jaxcalib.case.safety_limits import USUAL_LIMITS, SafetyLimits
from jaxcalib.measures.drive_tally import DriveTally
from jaxcalib.measures.lane_change import num_target_gap_classes
from jaxcalib.measures.measure import Measure, MeasureValue
from jaxcalib.measures.observed_road import EndingRows, ObservedRoad
from jaxcalib.measures.registry import all_folds, all_measures
from jaxcalib.measures.scene import MeasureSettings
from jaxcalib.measures.whole_drive import WholeDriveFold
from surrogate.road.perception import PerceptionFrame

NUM_FRAMES = 8
NUM_TRACKS = 8  # one for the subject vehicle, one for what has no track: numbers 0 to 5 are remembered


@pytest.fixture(scope="session")
def road() -> ObservedRoad:
    """1000 m with two lanes, rows 0 and 1, and from 300 m to 500 m an auxiliary lane, row 2, to the right of them.

    There vehicles merge; from 700 m to 850 m row 2 leads to an exit.
    """
    return ObservedRoad(
        section_border_m=jnp.asarray([0.0, 400.0, 1000.0]),
        knot_m=jnp.asarray([0.0, 300.0, 500.0, 1000.0]),
        lane_m=jnp.asarray([0.0, 600.0, 1200.0, 2200.0]),
        lateral_order=jnp.asarray([1.0, 2.0, 0.0]),
        ending=EndingRows(
            jnp.asarray([2.0, 2.0]), jnp.asarray([300.0, 700.0]), jnp.asarray([500.0, 850.0]), jnp.asarray([0.0, 1.0])
        ),
    )


@pytest.fixture(scope="session")
def tally(road: ObservedRoad) -> DriveTally:
    settings = MeasureSettings(
        road=road,
        nominal_length_m=jnp.asarray(4.5),
        least_speed_mps=jnp.asarray(2.0),
        longest_headway_s=jnp.asarray(6.0),
        limits=SafetyLimits(*(jnp.asarray(limit) for limit in USUAL_LIMITS)),
        num_tracks=NUM_TRACKS,
        num_target_gap_classes=num_target_gap_classes(100.0, 60.0, 4.5),
    )
    return DriveTally(settings, all_folds(settings))


@pytest.fixture(scope="session")
def count(tally: DriveTally) -> Callable[[PerceptionFrame], dict[str, float]]:
    """Return a function that gives the tallies of a drive by name."""
    fold = WholeDriveFold(tally, NUM_FRAMES)

    def counted(frames: PerceptionFrame) -> dict[str, float]:
        return dict(zip(tally.names, fold(frames).tolist(), strict=True))

    return counted


@pytest.fixture(scope="session")
def measures(tally: DriveTally) -> Mapping[str, Measure]:
    return all_measures(tally.settings)


@pytest.fixture(scope="session")
def measure(
    count: Callable[[PerceptionFrame], dict[str, float]], measures: Mapping[str, Measure]
) -> Callable[[PerceptionFrame, str], MeasureValue]:
    """Return a function that gives one measure of a drive."""
    return lambda frames, name: measures[name].value(count(frames))
