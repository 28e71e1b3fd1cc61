"""Fields without any effect, made of a kept case's null runs: how often a diagnosis sees something where nothing is.

Some of SUMO's drives with the calibrated values are the field, the others its null. What a diagnosis would check in
SUMO then is judged by the surrogate's word. Whether values are found back is no part of it: they are exact here.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from experiments.blind_effects.seal import file_hash
from experiments.diagnosis_bank.kept_case import KeptCase
from jaxcalib.diagnosis.inference import investigation
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import NotTestableError, prepare
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, UNKNOWN
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.diagnosis.stages.judged import judge_drives
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.simulated import simulate_null, trial_book_of
from jaxcalib.diagnosis.stages.tried import try_effects

NO_ALARM = ("no_gap", "miscalibrated")


@dataclass(frozen=True)
class MadeUpNull:
    """What was said of a field without effect."""

    road: str  # tells roads apart
    kind: str  # of the verdict
    probability_of_none: float
    probability_of_unknown: float


def judge_made_up_nulls(case: KeptCase, num_fields: int, seed: int = 0) -> Iterator[MadeUpNull]:
    """Make fields of a kept case's null runs, judge each, and keep the trials that this takes."""
    random = np.random.default_rng(seed)
    road = _road_of(case.case)
    # the calibrated inflows are these fields' own: whether the scenario's are wrong is another question
    with patch.object(investigation, "explain_ramps", lambda *_: None), case.session(may_run=True) as session:
        simulated = simulate_null(session, case.calibrated(session))
        for _ in range(num_fields):
            try:
                made = made_up_baseline(session, simulated.baseline, random)
            except NotTestableError:
                continue
            tried = try_effects(session, made, trial_book_of(simulated.baseline, session))
            judged = judge_drives(session, made, tried.num_places, Checked(tried.explained, tried.signatures, ()))
            verdict = judged.verdict
            yield MadeUpNull(road, verdict.kind, verdict.probability[NONE], verdict.probability[UNKNOWN])


def made_up_baseline(session: DiagnosisSession, baseline: Baseline, random: np.random.Generator) -> Baseline:
    """Return a baseline whose drives to fit are of some of its null runs, which are taken out of these.

    Each drive is of a run of its own, as drives on a road are; a third of the runs stays at least.

    Raises:
        NotTestableError: such drives show too little.
    """
    plain, altered = baseline.runs.plain, baseline.runs.altered
    first = max((len(tallies) for tallies in altered.values()), default=0)  # altered versions are theirs
    groups = np.arange(len(plain)) if plain.run is None else plain.run
    free = np.setdiff1d(groups, groups[:first])
    names = random.permutation(free)[: min(int(session.is_fit.sum()), 2 * len(np.unique(groups)) // 3)]
    chosen = np.asarray([random.choice(np.flatnonzero(groups == name)) for name in names])
    runs = NullRuns(plain.take(~np.isin(groups, names)), altered)
    drawn = replace(plain.take(chosen), run=None)
    fitted = prepare(session.problem, drawn, runs, baseline.trials, baseline.prior_steps)
    return replace(baseline, runs=runs, fitted=fitted)


def by_road(found: Iterable[MadeUpNull]) -> list[Mapping[str, Any]]:
    """Return a row for each road, and one for all."""
    roads: dict[str, list[MadeUpNull]] = defaultdict(list)
    for each in found:
        roads[each.road].append(each)
    everything = [each for several in roads.values() for each in several]
    return [_row(road, several) for road, several in (*sorted(roads.items()), ("all", everything))]


def _row(road: str, several: list[MadeUpNull]) -> Mapping[str, Any]:
    return {
        "road": road,
        "fields": len(several),
        "alarms": sum(each.kind not in NO_ALARM for each in several),
        "of them unknown": sum(each.kind == UNKNOWN for each in several),
        "probability of none, mean": round(float(np.mean([each.probability_of_none for each in several])), 2),
        "largest probability of unknown": round(max(each.probability_of_unknown for each in several), 2),
    }


def _road_of(case: Path) -> str:
    return file_hash(next((case / "scenario").glob("*.net.xml")))[:6]
