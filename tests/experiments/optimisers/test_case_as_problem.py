"""A case as a problem for the study of optimisers, on the toy problem."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.optimisers.case_problem import CaseProblem, PreparedCase
from experiments.optimisers.course import Budget, run_course
from experiments.optimisers.registry import OPTIMISERS
from jaxcalib.calibration.objective.evidence import independent_evidence
from jaxcalib.calibration.stages.search_box import search_box
from sim_adapters.interface import DriveStart
from tests.jaxcalib.calibration.toy import SPACE, TRUTH, ToySimulator, tallies, toy_objective

START = np.asarray([0.9, 0.3, 0.85])
FIT, HELD_OUT = (300.0, 320.0), (340.0, 360.0)


def prepared(simulator: ToySimulator, **options: Any) -> PreparedCase:
    drives = {"fit": range(900, 908), "held_out": range(950, 954)}
    departs_s = {"fit": FIT, "held_out": HELD_OUT} | options
    stub: Any = SimpleNamespace(
        case=SimpleNamespace(name="toy"),
        drive_starts=lambda role: tuple(map(DriveStart, departs_s[role])),
        field_of=lambda role: np.stack([tallies(TRUTH, seed) for seed in drives[role]])[: 4 * len(departs_s[role])],
    )
    evidence = independent_evidence(START, np.full(3, np.inf))
    box = search_box(START, range(3), np.asarray([0.5, 0.25, 0.5]))
    engine: Any = simulator
    initial: Any = SimpleNamespace(space=SPACE)
    return PreparedCase(stub, engine, initial, box, toy_objective(evidence), 4, 16)


def test_candidates_are_judged_as_in_a_calibration_and_results_on_fresh_seeds_and_held_out_drives():
    simulator = ToySimulator()
    ready = prepared(simulator)
    problem, box = CaseProblem(ready, 2), ready.box
    assert box.unit_of(problem.start[None])[0] == pytest.approx(START)
    told = problem.evaluate(np.asarray([[0.4, 0.9, 0.2], [0.9, 0.1, 0.9]]), 0)
    searched = simulator.requests[:]
    assert told.accuracy[0] > told.accuracy[1]
    assert {one.depart_s for one in searched} == set(FIT)
    assert {one.seed for one in searched[:4]} == {one.seed for one in searched[4:]}  # common random numbers
    assert SPACE.unit_of(np.asarray(searched[0].values))[1] == pytest.approx(0.05 + 0.9 * 0.5, abs=1e-4)

    simulator.requests.clear()
    errors = problem.measure(np.vstack([box.box_of(TRUTH[None]), problem.start]))
    fresh = simulator.requests
    assert {one.depart_s for one in fresh} == {*FIT, *HELD_OUT}
    assert not {one.seed for one in fresh} & {one.seed for one in searched}
    assert (
        len({one.seed for one in fresh if one.depart_s in FIT} & {one.seed for one in fresh if one.depart_s > 330}) == 0
    )
    for values in errors.values():
        assert values[0] < 0.5 * values[1]


def test_a_case_without_held_out_drives_is_judged_by_those_to_fit():
    problem = CaseProblem(prepared(ToySimulator(), held_out=()), 0)
    errors = problem.measure(START[None])
    assert np.isfinite(errors["error_fit"]).all()
    assert np.array_equal(errors["error"], errors["error_fit"])


@pytest.mark.parametrize("name", ["trust_region", "gradient_descent", "saga_polish"])
def test_optimisers_search_a_case_part_of_which_fails(name: str, tmp_path: Any):
    problem = CaseProblem(prepared(ToySimulator(failing=(0.1, 0.2))), 1)
    rows = run_course(name, OPTIMISERS[name], problem, Budget(60), tmp_path / "a.jsonl")
    assert rows[-1]["error_fit"] < 0.6 * problem.measure(problem.start[None])["error_fit"][0]
