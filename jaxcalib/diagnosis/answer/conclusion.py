"""Puts verdict, ranking, ledger and shrinkage together."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np

from jaxcalib.diagnosis.answer.answer import LISTED_ENTRIES, Diagnosis, Ranked, Second, WhereEntry
from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.answer.remarks import not_testable, unexplained, warnings_of
from jaxcalib.diagnosis.features.features import Cell
from jaxcalib.diagnosis.features.noise import on_cells
from jaxcalib.diagnosis.inference.further import best_effect, most_flexible_shift, next_steps, second_effect
from jaxcalib.diagnosis.inference.investigation import gain_of, transfer
from jaxcalib.diagnosis.inference.ledger import LedgerEntry, parameter_shift
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, UNKNOWN
from jaxcalib.diagnosis.inference.shrinkage import measure_shrinkage
from jaxcalib.diagnosis.inference.verdict import Verdict
from jaxcalib.diagnosis.runs.explained_runs import moved_values
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.problem.problem import CalibrationProblem
from surrogate.effects.registry import EFFECTS, effect_named

OTHER = "everything else"
HOW_FAR = ("gap_default", "gap_recalibrated", "gap_with_effect", "noise_floor", "fraction_closed",
           "fraction_closed_ci90")  # fmt: skip


def conclude(findings: Findings) -> Diagnosis:
    """Return the diagnosis."""
    problem, fitted = findings.problem, findings.fitted
    verdict = findings.verdict
    best = best_effect(findings.explained, verdict)
    second = None
    if best is not None:
        second = second_effect(fitted.difference, fitted.null, best, findings.signatures, findings.num_places)
    nowhere: dict[str, float | None] = dict.fromkeys(effect.name for effect in EFFECTS)
    visible = nowhere | {name: reported(name, one.visible_from) for name, one in findings.atlas.items()}
    visible_with_more = nowhere | {name: reported(name, one.visible_with_more) for name, one in findings.atlas.items()}
    ledger = findings.ledger()
    how_far = _how_far(findings, verdict)
    return Diagnosis(
        verdict=verdict.kind,
        effects=verdict.effects,
        reason=verdict.reason,
        ranking=_ranking(findings, verdict),
        where=_where(ledger, float(np.asarray(problem.road.section_border_m)[-1])),
        how_far=how_far,
        checked_in_sumo=tuple(replace(one, strength=reported(one.effect, one.strength)) for one in findings.checks),
        second_effect=None
        if second is None
        else Second(second.name, second.log_evidence, reported(second.name, second.strength)),
        next_steps=next_steps(
            verdict,
            second,
            {name: list(one.alike) for name, one in findings.atlas.items()},
            [_named_with_place(one.cell) for one in ledger[:3]],
            visible_with_more,
            visible,
        ),
        undetectable_below=visible,
        visible_with_three_more_drives=visible_with_more,
        parameters=_parameters(findings),
        not_testable=not_testable(findings),
        warnings=[*warnings_of(findings), *unexplained(verdict, how_far)],
        runs=findings.runs,
        wall_s=findings.wall_s,
    )


def refuse(
    problem: CalibrationProblem,
    values: np.ndarray,
    reason: str,
    runs: Mapping[str, int],
    wall_s: Mapping[str, float],
) -> Diagnosis:
    """Return the diagnosis of drives that show too little."""
    names = problem.layout.names
    return Diagnosis(
        verdict="not_testable",
        effects=(),
        reason=f"The drives show too little: {reason}.",
        ranking=[Ranked(NONE, 1.0), *(Ranked(effect.name, 0.0) for effect in EFFECTS), Ranked(UNKNOWN, 0.0)],
        where=[],
        how_far=dict.fromkeys(HOW_FAR),
        checked_in_sumo=(),
        second_effect=None,
        next_steps=("Record more or longer drives.",),
        undetectable_below=dict.fromkeys(effect.name for effect in EFFECTS),
        visible_with_three_more_drives={},
        parameters={
            "scenario": dict(zip(names, problem.template.base_values().tolist(), strict=True)),
            "calibrated": dict(zip(names, values.tolist(), strict=True)),
        },
        not_testable={effect.name: reason for effect in EFFECTS},
        warnings=list(problem.warnings()),
        runs=runs,
        wall_s=wall_s,
    )


def _parameters(findings: Findings) -> dict[str, dict[str, float]]:
    """Return the values of the scenario, of the calibration, and of the fit with the effect that is named first."""
    layout, values = findings.problem.layout, findings.values
    several = {"scenario": findings.problem.template.base_values(), "calibrated": values}
    if findings.refit is not None:
        several["with_effect"] = moved_values(values, parameter_steps(layout, values), findings.refit.steps)
    return {name: dict(zip(layout.names, one.tolist(), strict=True)) for name, one in several.items()}


def _ranking(findings: Findings, verdict: Verdict) -> list[Ranked]:
    probability = verdict.probability
    none = next(one.log_evidence for one in findings.explained if one.name == NONE)
    ranking = []
    for one in findings.explained:
        gain = float(one.log_evidence - none)
        if one.name in (NONE, UNKNOWN):
            ranking.append(Ranked(one.name, probability[one.name], log_evidence=gain))
            continue
        low, high = (reported(one.name, bound) for bound in one.interval)
        atlas = findings.atlas.get(one.name)
        ranking.append(
            Ranked(
                effect=one.name,
                probability=probability[one.name],
                strength=reported(one.name, one.strength),
                strength_ci90=(low, high),
                absorption=atlas.absorption if atlas else None,
                held_out_gain=gain_of(one, findings.held_out, findings.fitted) if findings.held_out else None,
                log_evidence=gain,
                cross_validated_gain=one.cross_validated_gain,
                place_and_time=dict(one.setting or {}),
                alike=dict(atlas.alike) if atlas else {},
            )
        )
    untested = [effect.name for effect in EFFECTS if effect.name not in {one.effect for one in ranking}]
    ranking += [Ranked(name, 0.0) for name in untested]
    return sorted(ranking, key=lambda one: -one.probability)


@overload
def reported(name: str, strength: float) -> float: ...
@overload
def reported(name: str, strength: None) -> None: ...
@overload
def reported(name: str, strength: float | None) -> float | None: ...
def reported(name: str, strength: float | None) -> float | None:
    """Return a strength in the effect's unit as people count it: a factor from 1."""
    return None if strength is None else strength + effect_named(name).reported_at_zero


def _named_with_place(cell: Cell) -> str:
    return cell.words if cell.from_m is None else f"{cell.words} ({cell.from_m:.0f} to {cell.to_m:.0f} m)"


def _where(ledger: Sequence[LedgerEntry], length_m: float) -> list[WhereEntry]:
    listed, rest = ledger[:LISTED_ENTRIES], ledger[LISTED_ENTRIES:]
    entries = [
        WhereEntry(
            mop=one.cell.measure,
            regime=one.cell.regime,
            role=one.cell.role,
            lane=one.cell.lane,
            route_from_m=0.0 if one.cell.from_m is None else one.cell.from_m,
            route_to_m=length_m if one.cell.to_m is None else one.cell.to_m,
            time_from_s=one.cell.from_s,
            time_to_s=one.cell.to_s,
            gap=one.excess,
            share=one.share,
            p_adjusted=one.p_adjusted,
            field=one.field,
            simulated=one.simulated,
            difference_in_noise=one.difference,
        )
        for one in listed
    ]
    if rest:
        gap, share = sum(one.excess for one in rest), 1.0 - sum(one.share for one in entries)
        least = min(one.p_adjusted for one in rest)
        entries.append(WhereEntry(OTHER, "", "", None, 0.0, length_m, None, None, gap, share, least))
    return entries


def _how_far(findings: Findings, verdict: Verdict) -> dict[str, Any]:
    held_out, fitted = findings.held_out, findings.fitted
    if held_out is None:
        return dict.fromkeys(HOW_FAR) | {"reason": "no drive is held out, or too little of it is seen"}
    null = held_out.null
    best = best_effect(findings.explained, verdict)
    flexible = most_flexible_shift(fitted.difference, fitted.null, findings.signatures)

    def recalibrated(shift: np.ndarray) -> np.ndarray:
        """Shift of the features with the parameters that the drives to fit then ask for."""
        steps = parameter_shift(fitted.difference - shift, fitted.null)
        return null.slope @ steps + transfer(shift, fitted.null, null)

    with_effect = None
    if findings.refit is not None:
        with_effect = findings.refit.expected(null, fitted.null)
    elif best is not None and best.shift is not None:
        with_effect = recalibrated(best.shift)
    as_it_is = None
    if findings.default is not None:
        as_it_is = null.standardised(on_cells(findings.default, null.cells).values())
    found = measure_shrinkage(
        held_out.tallies,
        null,
        findings.null_runs,
        {
            "default": as_it_is,
            "recalibrated": recalibrated(np.zeros_like(fitted.difference)),
            "with_effect": with_effect,
            "ceiling": recalibrated(flexible),
        },
        np.random.default_rng(findings.seed),
        None if findings.refit is None else findings.refit.runs,
        fitted.tallies,
    )
    values = (
        found.default,
        found.recalibrated,
        found.with_effect,
        found.floor,
        found.fraction_closed,
        found.interval_90,
    )
    return dict(zip(HOW_FAR, values, strict=True)) | {
        "effect": best.name if best else None,
        "gap_ceiling": found.ceiling,
    }
