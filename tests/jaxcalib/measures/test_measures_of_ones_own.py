"""A measure of one's own is a file and its line in the registry: field, both simulators and the objective know it."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxcalib.calibration.objective.moments import all_moments
from jaxcalib.measures import registry
from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import LeftOut, Level, Measure
from jaxcalib.measures.measure_group import MeasureGroup
from jaxcalib.measures.scene import Scene
from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunRequest
from tests.copies import copy_corridor

NUM_RUNS = 4
END_S, DEPART_S = 150.0, 91.0  # runs end while the subject vehicle is on its way

# As a file of its own would have it: a quotient of tallies that there are already ...
FOLLOWING_SHARE = MeasureGroup(
    lambda settings: (
        Measure(
            "subject_following_share", "share of its time in which the subject vehicle follows", Level.VEHICLE,
            "subject_following_frames", "subject_frames",
        ),
    )
)  # fmt: skip


# ... and a measure that needs a fold of its own.
class ShortHeadways(Fold):
    """Frames in which the subject vehicle follows at a time headway of less than 2 s."""

    def names(self) -> tuple[str, ...]:
        return ("subject_short_headway_frames",)

    def count(self, scene: Scene) -> dict[str, Array]:
        is_short = scene.is_subject & scene.is_vehicle & (scene.headway_s < 2.0)
        return {"subject_short_headway_frames": jnp.sum(is_short.astype(jnp.float32))}


SHORT_HEADWAYS = MeasureGroup(
    lambda settings: (
        Measure(
            "subject_short_headway_share", "share of time headways below 2 s", Level.VEHICLE,
            "subject_short_headway_frames", "subject_following_frames", left_out=LeftOut.BIN,
        ),
    ),
    lambda settings: (ShortHeadways(),),
)  # fmt: skip


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> CalibrationProblem:
    """A drive on the corridor, with both measures in the registry."""
    folder = copy_corridor(tmp_path_factory.mktemp("case") / "corridor", "d01")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "GROUPS", (*registry.GROUPS, FOLLOWING_SHARE, SHORT_HEADWAYS))
        problem = read_problem(folder)
    parts = replace(problem.parts, scenario=replace(problem.parts.scenario, duration_s=END_S))
    return replace(problem, parts=parts)


def check(problem: CalibrationProblem, tally: np.ndarray) -> None:
    """Both measures have values, and those that the measures of the library imply."""
    by_name = dict(zip(problem.tally_names, tally.tolist(), strict=True))
    following = problem.measures["subject_following_share"].value(by_name)
    assert following.is_valid
    not_following = by_name["subject_headways_censored"] / by_name["subject_frames"]
    assert following.value == pytest.approx(1.0 - not_following)
    short = problem.measures["subject_short_headway_share"].value(by_name)
    assert short.is_valid
    shares = [problem.measures[f"subject_time_headway_share_{span}_s"].value(by_name).value for span in (
        "0_0.75", "0.75_1", "1_1.25", "1.25_1.5", "1.5_1.75", "1.75_2",
    )]  # fmt: skip
    assert short.value == pytest.approx(sum(shares))
    assert short.num_observations > 0


def test_the_field_is_measured(problem: CalibrationProblem):
    assert list(problem.measures)[-2:] == ["subject_following_share", "subject_short_headway_share"]
    assert problem.tally_names[-1] == "subject_short_headway_frames"
    check(problem, problem.field_tally.sum(axis=0))


def test_a_quotient_enters_the_objective_unless_it_says_otherwise(problem: CalibrationProblem):
    moments = all_moments(problem.measures, problem.tally_index)
    assert "cut_in_time_gap_s" not in moments.names
    assert moments.names[-1] == "subject_following_share"
    assert "subject_short_headway_share" not in moments.names
    value = moments.values(problem.field_tally.sum(axis=0))[-1]
    tally = dict(zip(problem.tally_names, problem.field_tally.sum(axis=0).tolist(), strict=True))
    assert value == problem.measures["subject_following_share"].value(tally).value


@pytest.mark.long
@pytest.mark.parametrize("engine", ["surrogate", "sumo"])
def test_both_simulators_are_measured(problem: CalibrationProblem, engine: str):
    values = tuple(problem.template.base_values().tolist())
    requests = [RunRequest(values, seed, DEPART_S) for seed in range(NUM_RUNS)]
    if engine == "surrogate":
        outcomes = surrogate_engine(problem, runs_per_device=NUM_RUNS).run(requests)
    else:
        with sumo_engine(problem, num_processes=1) as simulator:
            outcomes = simulator.run(requests)
    assert all(outcome.status.is_ok for outcome in outcomes)
    check(problem, np.sum([outcome.observed for outcome in outcomes], axis=0, dtype=float))
