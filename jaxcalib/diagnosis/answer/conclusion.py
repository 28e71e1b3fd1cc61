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
from jaxcalib.diagnosis.inference.further import best_effect, most_flexible_shift, next_steps
from jaxcalib.diagnosis.inference.investigation import gain_of, transfer
from jaxcalib.diagnosis.inference.ledger import LedgerEntry, parameter_shift
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, UNKNOWN, none_among
from jaxcalib.diagnosis.inference.shrinkage import measure_shrinkage
from jaxcalib.diagnosis.inference.verdict import Verdict, beforehand
from jaxcalib.diagnosis.runs.explained_runs import moved_values
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.problem.problem import CalibrationProblem
from surrogate.effects.registry import EFFECTS, effect_named

OTHER = "everything else"
HOW_FAR = ("gap_default", "gap_recalibrated", "gap_with_effect", "noise_floor", "fraction_closed",
           "fraction_closed_ci90")  # fmt: skip


def conclude(findings: Findings) -> Diagnosis:
    """Return the diagnosis."""
    problem = findings.problem
    verdict = findings.verdict
    nowhere: dict[str, float | None] = dict.fromkeys(effect.name for effect in EFFECTS)
    visible = nowhere | {name: reported(name, entry.visible_from) for name, entry in findings.atlas.items()}
    visible_with_more = nowhere | {
        name: reported(name, entry.visible_with_more) for name, entry in findings.atlas.items()
    }
    ledger = findings.ledger()
    how_far = _how_far(findings, verdict)
    return Diagnosis(
        verdict=verdict.kind,
        effects=verdict.effects,
        reason=verdict.reason,
        ranking=_ranking(findings, verdict),
        where=_where(ledger, float(np.asarray(problem.road.section_border_m)[-1])),
        how_far=how_far,
        checked_in_sumo=tuple(
            replace(check, strength=reported(check.effect, check.strength)) for check in findings.checks
        ),
        second_effect=_second(findings),
        next_steps=next_steps(
            verdict,
            {name: list(entry.alike) for name, entry in findings.atlas.items()},
            [_named_with_place(entry.cell) for entry in ledger[:3]],
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


def _second(findings: Findings) -> Second | None:
    """Return the second of two effects that are both named."""
    if findings.verdict.kind != "pair" or findings.pairs is None:
        return None
    pair = findings.pairs.best
    return Second(pair.names[1], findings.pairs.gain, reported(pair.names[1], pair.strengths[1]))


def refuse(
    problem: CalibrationProblem,
    values: np.ndarray,
    reason: str,
    runs: Mapping[str, int],
    wall_s: Mapping[str, float],
) -> Diagnosis:
    """Return the diagnosis of drives that show too little: each explanation is as likely as before."""
    names = problem.layout.names
    ranking = beforehand([NONE, *(effect.name for effect in EFFECTS), UNKNOWN])
    return Diagnosis(
        verdict="not_testable",
        effects=(),
        reason=f"The drives show too little: {reason}.",
        ranking=sorted((Ranked(*one) for one in ranking.items()), key=lambda one: -one.probability),
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
    return {name: dict(zip(layout.names, fitted.tolist(), strict=True)) for name, fitted in several.items()}


def _ranking(findings: Findings, verdict: Verdict) -> list[Ranked]:
    probability = verdict.probability
    none = none_among(findings.explained).log_evidence
    ranking = []
    for explanation in findings.explained:
        gain = float(explanation.log_evidence - none)
        if not explanation.is_effect:
            ranking.append(Ranked(explanation.name, probability[explanation.name], log_evidence=gain))
            continue
        low, high = (reported(explanation.name, bound) for bound in explanation.interval)
        atlas = findings.atlas.get(explanation.name)
        ranking.append(
            Ranked(
                effect=explanation.name,
                probability=probability[explanation.name],
                strength=reported(explanation.name, explanation.strength),
                strength_ci90=(low, high),
                absorption=atlas.absorption if atlas else None,
                held_out_gain=gain_of(explanation, findings.held_out, findings.fitted) if findings.held_out else None,
                log_evidence=gain,
                place_and_time=dict(explanation.setting or {}),
                alike=dict(atlas.alike) if atlas else {},
            )
        )
    untested = [effect.name for effect in EFFECTS if effect.name not in {entry.effect for entry in ranking}]
    ranking += [Ranked(name, 0.0) for name in untested]
    return sorted(ranking, key=lambda entry: -entry.probability)


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
            mop=entry.cell.measure,
            regime=entry.cell.regime,
            role=entry.cell.role,
            lane=entry.cell.lane,
            route_from_m=0.0 if entry.cell.from_m is None else entry.cell.from_m,
            route_to_m=length_m if entry.cell.to_m is None else entry.cell.to_m,
            time_from_s=entry.cell.from_s,
            time_to_s=entry.cell.to_s,
            gap=entry.excess,
            share=entry.share,
            p_adjusted=entry.p_adjusted,
            field=entry.field,
            simulated=entry.simulated,
            difference_in_noise=entry.difference,
        )
        for entry in listed
    ]
    if rest:
        gap, share = sum(entry.excess for entry in rest), 1.0 - sum(entry.share for entry in entries)
        least = min(entry.p_adjusted for entry in rest)
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
    if verdict.kind == "pair" and findings.pairs is not None:
        with_effect = recalibrated(findings.pairs.best.shift)
    elif findings.refit is not None:
        with_effect = findings.refit.expected(null, fitted.null)
    elif best is not None and best.shift is not None:
        with_effect = recalibrated(best.shift)
    as_it_is = None
    if findings.default is not None:
        as_it_is = null.standardised(on_cells(findings.default, null.cells).values())
    shrinkage = measure_shrinkage(
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
        shrinkage.default,
        shrinkage.recalibrated,
        shrinkage.with_effect,
        shrinkage.floor,
        shrinkage.fraction_closed,
        shrinkage.interval_90,
    )
    return dict(zip(HOW_FAR, values, strict=True)) | {
        "effect": best.name if best else None,
        "gap_ceiling": shrinkage.ceiling,
    }
