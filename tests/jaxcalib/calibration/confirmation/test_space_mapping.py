from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.confirmation import MAPPED, Confirmation, Finals
from jaxcalib.calibration.confirmation.discrepancy import Confirmed, learn_discrepancy
from jaxcalib.calibration.confirmation.search_on import leaves_more_than_noise
from jaxcalib.calibration.confirmation.space_mapping import SHARES, as_field, search_mapped, shifted
from jaxcalib.calibration.objective.evidence import Evidence, independent_evidence
from jaxcalib.calibration.result.uncertainty import parameter_errors
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.runs.session import Session, open_session
from tests.jaxcalib.calibration.toy import SPACE, TRUTH, ToySimulator, starts_at, toy_objective

SHIFT = np.asarray([-0.15, 0.1, -0.2])  # the surrogate drives as SUMO does at values so far away
BUDGET = Budget(8, 16, 16, 64, 32, 5, 2, 64, 2, 2, 3)
STARTS = starts_at(300.0, 320.0)


@pytest.fixture
def session() -> Iterator[Session]:
    with open_session(None, {}) as opened:
        yield opened


def finals_of(session: Session, sumo: ToySimulator, shift: np.ndarray | float = SHIFT) -> Finals:
    evaluators = (Evaluator(simulator, STARTS, 50) for simulator in (ToySimulator(shift=shift), sumo))
    return Finals(SPACE, *evaluators, plan=BUDGET, session=session)


def begin(
    finals: Finals, unit: np.ndarray, evidence: Evidence | None = None, **options: bool
) -> tuple[Confirmation, SimpleNamespace]:
    """What a search in the surrogate leaves that ended at a point."""
    objective = replace(toy_objective(evidence, num_drives=64), **options)
    runs = finals.run(unit, "two stages", objective)
    assert runs.finalist is not None
    assert runs.confirmed is not None
    learnt = learn_discrepancy(objective.moments, objective.covariance, objective.num_drives, [runs.confirmed])
    corrected = replace(objective, discrepancy=learnt)
    confirmation = Confirmation((runs.finalist,), 0, True, learnt, corrected, (runs.confirmed,), runs.outcomes)
    return confirmation, SimpleNamespace(best=unit, judged=[], half_width=np.full(3, 0.35))


def lacking(one: Confirmed) -> np.ndarray:
    """What the surrogate's moments lack at a point."""
    moments = toy_objective().moments
    return moments.values(one.sumo) - moments.values(one.surrogate)


@pytest.mark.parametrize("evidence", [None, independent_evidence(TRUTH, np.full(3, 0.03))])
def test_steps_lead_to_where_sumo_drives_as_the_field_does(session: Session, evidence: Evidence | None):
    sumo = ToySimulator()
    finals = finals_of(session, sumo)
    confirmation, found = begin(finals, TRUTH - SHIFT, evidence)  # where the surrogate drives as the field does
    mapped = search_mapped(confirmation, found, finals)
    assert np.linalg.norm(mapped.best - TRUTH) < 0.35 * np.linalg.norm(SHIFT)
    assert 1.0 - mapped.finalists[mapped.winner].accuracy < 0.5 * (1.0 - confirmation.finalists[0].accuracy)
    assert len(sumo.requests) == BUDGET.confirmation_runs * len(mapped.finalists) == len(mapped.outcomes)
    assert len(mapped.finalists) < 1 + len(SHARES) * BUDGET.most_mappings  # it ends where nothing more is gained
    assert mapped.went_on_by == [MAPPED]
    assert leaves_more_than_noise(confirmation)
    assert not leaves_more_than_noise(mapped)


def test_where_the_two_drive_alike_the_surrogates_own_optimum_is_found(session: Session):
    finals = finals_of(session, ToySimulator(), shift=0.0)
    confirmation, found = begin(finals, TRUTH - SHIFT)  # where a search ended too early
    mapped = search_mapped(confirmation, found, finals)
    assert np.linalg.norm(mapped.best - TRUTH) < 0.35 * np.linalg.norm(SHIFT)


def test_what_the_data_know_is_asked_where_the_surrogate_drives_as_sumo_does(session: Session):
    finals = finals_of(session, ToySimulator())
    confirmation, found = begin(finals, TRUTH - SHIFT)
    found.half_width = np.full(3, 0.1)  # less than the shift
    mapped = search_mapped(confirmation, found, finals)
    assert mapped.shift is not None
    assert mapped.best_in_surrogate == pytest.approx(np.clip(mapped.best + mapped.shift, 0.0, 1.0))
    assert np.linalg.norm(mapped.best_in_surrogate - (mapped.best - SHIFT)) < 0.5 * np.linalg.norm(SHIFT)
    record = SimpleNamespace(confirmation=mapped, initial=SimpleNamespace(space=SPACE), found=found)
    assert (parameter_errors(record) < 0.1).all()
    unit = mapped.best_in_surrogate + 0.09 * (2.0 * np.random.default_rng(1).random((40, 3)) - 1.0)
    run = SearchRun(finals.surrogate, SPACE, confirmation.objective)
    near = replace(mapped, judged=(run.judge(unit, 64, "near"),))
    assert (parameter_errors(SimpleNamespace(confirmation=near, initial=record.initial, found=found)) < 0.1).all()
    unmapped = replace(near, shift=None)  # nobody has driven near SUMO's own values
    assert np.isinf(parameter_errors(SimpleNamespace(confirmation=unmapped, initial=record.initial, found=found))).all()


def test_no_point_is_run_twice(session: Session):
    sumo = ToySimulator()
    finals = finals_of(session, sumo)
    search_mapped(*begin(finals, TRUTH - SHIFT), finals)
    assert len({(request.values, request.seed) for request in sumo.requests}) == len(sumo.requests)


def test_relative_errors_are_left_to_other_searches(session: Session):
    finals = finals_of(session, ToySimulator())
    confirmation, found = begin(finals, TRUTH - SHIFT, is_relative=True)
    assert search_mapped(confirmation, found, finals) is confirmation
    assert leaves_more_than_noise(confirmation)


def test_the_corrected_surrogate_is_asked_again_which_finalist_is_best(session: Session):
    finals = finals_of(session, ToySimulator())
    confirmation, _ = begin(finals, TRUTH)
    objective = replace(confirmation.objective, discrepancy=None)
    elsewhere = finals.run(TRUTH - SHIFT, "elsewhere", objective)
    worse = replace(confirmation, agrees=False).joined([elsewhere])
    assert (worse.winner, worse.agrees, worse.went_on_by) == (0, True, [])
    assert worse.discrepancy is worse.objective.discrepancy
    before, after = (
        np.abs(one.discrepancy.predict(elsewhere.finalist.unit[None])[0] - lacking(elsewhere.confirmed)).max()
        for one in (confirmation, worse)
    )
    assert after < 0.5 * before  # it has learnt from the new one, too


def test_points_at_which_sumo_fails_are_no_finalists(session: Session):
    sumo = ToySimulator(failing=(TRUTH[1] - SHIFT[1] + 0.005, 1.0))  # next to the surrogate's result
    finals = finals_of(session, sumo)
    confirmation, found = begin(finals, TRUTH - SHIFT)
    mapped = search_mapped(confirmation, found, finals)
    assert mapped.finalists == confirmation.finalists
    assert mapped.winner == 0
    assert len(mapped.outcomes) == 3 * len(confirmation.outcomes)  # told nevertheless


def test_no_steps_are_taken_where_the_budget_has_none(session: Session):
    finals = replace(finals_of(session, ToySimulator()), plan=replace(BUDGET, most_mappings=0))
    confirmation, found = begin(finals, TRUTH - SHIFT)
    assert search_mapped(confirmation, found, finals) is confirmation


def test_what_sumo_showed_takes_the_place_of_the_field_and_its_values_that_of_what_is_known():
    objective = toy_objective(independent_evidence(np.full(3, 0.5), np.full(3, 0.1)))
    sumo = np.concatenate([100.0 * np.asarray([5.5, 9.5, 4.5, 7.5]), np.full(4, 100.0), [1.0]])
    sumo[[1, 5]] = 0.0  # never shown
    unit = np.asarray([0.2, 0.3, 0.4])
    goal = as_field(objective, unit, Confirmed(unit, sumo, 16, sumo, 12.0))
    assert goal.field == pytest.approx([5.5, objective.usual[1], 4.5, 7.5])
    assert goal.num_drives == 12.0
    assert goal.residuals(unit[None], sumo[None], 16)[0] == pytest.approx(np.zeros(7))
    assert np.abs(goal.residuals(unit[None] + 0.1, sumo[None], 16)[0, 4:]) == pytest.approx(np.ones(3))


def test_a_shift_moves_what_is_known_to_the_surrogates_values():
    objective = toy_objective(independent_evidence(np.full(3, 0.5), np.full(3, 0.1)))
    moved, unit = shifted(objective, SHIFT), np.asarray([[0.2, 0.3, 0.4]])
    tallies = np.concatenate([100.0 * objective.field, np.full(4, 100.0), [1.0]])[None]
    assert moved.residuals(unit + SHIFT, tallies, 8) == pytest.approx(objective.residuals(unit, tallies, 8))
