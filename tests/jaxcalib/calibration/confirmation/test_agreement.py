"""Surrogate against SUMO, section by section: the criterion fails where a section drives otherwise."""

import json

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.agreement import CHANCE, SPEED_TOLERANCE, compare_sections
from jaxcalib.problem.problem import CalibrationProblem

FRAMES = 200.0


def tally_of(problem: CalibrationProblem, speed_mps: np.ndarray, frames: float = FRAMES) -> np.ndarray:
    """Return tallies in which vehicles drive at a speed in each section."""
    tally = np.zeros(len(problem.tally_names))
    for section, speed in enumerate(speed_mps):
        tally[problem.tally_index[f"section_frames[{section}]"]] = frames
        tally[problem.tally_index[f"section_speed[{section}]"]] = frames * speed
    return tally


@pytest.fixture(scope="module")
def speed_mps(small_problem: CalibrationProblem) -> np.ndarray:
    return np.linspace(31.0, 12.0, small_problem.road.num_sections)


def runs_at(problem: CalibrationProblem, speed_mps: np.ndarray, spread: float = 0.0) -> np.ndarray:
    return np.stack([tally_of(problem, speed_mps * (1.0 + spread * side)) for side in (-1.0, 1.0, -1.0, 1.0)])


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.09, True), (0.91, True), (1.11, False), (0.5, False)])
def test_speeds_within_the_tolerance_hold(
    small_problem: CalibrationProblem, speed_mps: np.ndarray, factor: float, holds: bool
) -> None:
    in_sumo = runs_at(small_problem, speed_mps)
    agreement = compare_sections(small_problem, tally_of(small_problem, factor * speed_mps), in_sumo, "here")
    assert len(agreement.sections) == len(speed_mps)
    assert agreement.holds is holds
    assert agreement.share_alike == float(holds)


def test_one_section_that_jams_in_one_of_them_is_named(
    small_problem: CalibrationProblem, speed_mps: np.ndarray
) -> None:
    jammed = speed_mps.copy()
    jammed[1] = 5.0
    agreement = compare_sections(
        small_problem, tally_of(small_problem, jammed), runs_at(small_problem, speed_mps), "at some values"
    )
    assert agreement.share_alike == pytest.approx(1.0 - 1.0 / len(speed_mps))
    line = str(agreement)
    assert "at some values" in line
    assert f"5.0 instead of {speed_mps[1]:.1f} m/s" in line
    assert json.loads(json.dumps(agreement.as_table()))["sections"][1]["is_alike"] is False


def test_what_chance_in_sumo_s_runs_explains_is_no_disagreement(
    small_problem: CalibrationProblem, speed_mps: np.ndarray
) -> None:
    spread = 0.1
    in_sumo = runs_at(small_problem, speed_mps, spread)
    standard_error = spread / np.sqrt(3.0)  # two runs above and two below, by the jackknife
    allowed = SPEED_TOLERANCE + CHANCE * standard_error
    for excess, holds in ((-0.001, True), (0.001, False)):
        ours = tally_of(small_problem, speed_mps * (1.0 + allowed + excess))
        assert compare_sections(small_problem, ours, in_sumo, "").holds is holds


def test_a_section_that_only_sumo_shows_is_apart_and_one_that_it_never_shows_does_not_count(
    small_problem: CalibrationProblem, speed_mps: np.ndarray
) -> None:
    in_sumo = runs_at(small_problem, speed_mps)
    assert not compare_sections(small_problem, np.zeros(in_sumo.shape[1]), in_sumo, "").holds
    nobody = compare_sections(small_problem, in_sumo[0], np.zeros_like(in_sumo), "")
    assert nobody.sections == ()
    assert nobody.holds
