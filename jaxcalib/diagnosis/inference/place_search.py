"""Local effects tried again nearby: begin and end, in place and time, are searched for from the first windows on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window, window_of
from jaxcalib.diagnosis.inference.atlas import EffectTrial, effect_trials, surrogate_signatures
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, explain, signature_behind
from surrogate.effects.base import Effect
from surrogate.effects.registry import effect_named

STEPS = ((100.0, 40.0), (50.0, 20.0))  # m and s, round by round
MOST_REFINED = 2  # local effects
AMONG_BEST = 4  # explanations
LEAST_IMPROVEMENT = 1.0  # of the log evidence
SHORTEST_M, SHORTEST_S = 100.0, 30.0
MOVES = ((1, 1), (-1, -1), (-1, 0), (1, 0), (0, -1), (0, 1))  # of begin and end, in steps

RunTrials = Callable[[Sequence[EffectTrial]], Mapping[str, DriveTallies]]


def refine_places(
    difference: np.ndarray,
    null: NullModel,
    disagrees: np.ndarray,
    explained: Sequence[Explained],
    signatures: Mapping[str, Sequence[Signature]],
    values: np.ndarray,
    num_runs: int,
    lanes: Sequence[int],
    run: RunTrials,
) -> dict[str, Sequence[Signature]]:
    """Return signatures with better places for the local effects among the best explanations.

    The cost of looking is that of the first windows: they cover the road, and what is tried here lies between them. The
    baseline's tallies are among what `run` returns.
    """
    refined = dict(signatures)
    local = [
        explanation
        for explanation in explained[:AMONG_BEST]
        if explanation.setting and "route_from_m" in explanation.setting
    ]
    for explanation in local[:MOST_REFINED]:
        effect = effect_named(explanation.name)
        best = signature_behind(refined[explanation.name], explanation)
        evidence = _evidence(difference, null, best, effect)
        for round_number, (step_m, step_s) in enumerate(STEPS):
            window = window_of(best)
            assert window is not None
            around = neighbours(window, step_m, step_s, lanes if round_number == 0 else ())
            trials = _nearest_strength(
                effect_trials(values, num_runs, {explanation.name: around}), explanation.name, explanation.strength
            )
            several = surrogate_signatures(trials, run(trials), null, disagrees).get(explanation.name, [])
            if not several:
                continue
            judged = [_evidence(difference, null, each, effect) for each in several]
            nearest = int(np.argmax(judged))
            if judged[nearest] < evidence + LEAST_IMPROVEMENT:
                continue
            best, evidence = several[nearest], judged[nearest]
        if not any(best is each for each in refined[explanation.name]):
            refined[explanation.name] = [*refined[explanation.name], best]
    return refined


def neighbours(window: Window, step_m: float, step_s: float, lanes: Sequence[int]) -> list[Window]:
    """Return windows that begin or end a step earlier or later, or lie in another of some lanes."""
    is_point = window.from_m == window.to_m
    windows = []
    for moved_from, moved_to in MOVES[:2] if is_point else MOVES:
        from_m, to_m = window.from_m + moved_from * step_m, window.to_m + moved_to * step_m
        if from_m >= 0.0 and (is_point or to_m - from_m >= SHORTEST_M):
            windows.append(replace(window, from_m=from_m, to_m=to_m))
    if window.from_s is not None and window.to_s is not None:
        for moved_from, moved_to in MOVES:
            from_s, to_s = window.from_s + moved_from * step_s, window.to_s + moved_to * step_s
            if from_s >= 0.0 and to_s - from_s >= SHORTEST_S:
                windows.append(replace(window, from_s=from_s, to_s=to_s))
    if window.lane is not None:
        windows += [replace(window, lane=lane) for lane in lanes if lane != window.lane]
    return windows


def _nearest_strength(trials: Sequence[EffectTrial], name: str, strength: float) -> list[EffectTrial]:
    """Return for each window the trial of the strength that is nearest."""
    own = [trial for trial in trials if trial.effect.name == name]
    windows = list(dict.fromkeys(trial.window for trial in own))
    return [
        min(
            (trial for trial in own if trial.window == window),
            key=lambda trial: abs(abs(trial.strength) - abs(strength)),
        )
        for window in windows
    ]


def _evidence(difference: np.ndarray, null: NullModel, signature: Signature, effect: Effect) -> float:
    return explain(difference, null, [signature], effect.medium).log_evidence
