"""What each parameter and each effect would do to the features: known before the field is looked at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, measured_shift
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial, has_pairs, paired_difference
from sim_adapters.interface import ParameterLayout
from surrogate.effects.base import Effect, EffectSetting, SearchedAt
from surrogate.effects.registry import EFFECTS, effect_named

ALTERED_EXACTNESS = 0.4  # of altered drives: no surrogate, but the same effect may come in another form
READING_EXACTNESS = 0.1  # of what reads an effect's strength from the log itself, whatever traffic makes of the effect


@dataclass(frozen=True)
class EffectTrial:
    """A trial of an effect."""

    effect: Effect
    strength: float  # its strength, with its sign
    window: Window | None  # where and when; None for everywhere
    trial: Trial  # what to run


@dataclass
class Slopes:
    """Change of the features with the parameters, and how features vary from drive to drive in the surrogate."""

    slope: np.ndarray
    error: np.ndarray
    influence: np.ndarray


def parameter_trials(layout: ParameterLayout, values: np.ndarray, num_runs: int, first_run: int = 0) -> list[Trial]:
    """Return the trials for slopes, the baseline first; runs before the first were made before."""
    steps = parameter_steps(layout, values)
    trials = [Trial(BASELINE, _tuple(values), num_runs, first_run=first_run)]
    for number, name in enumerate(layout.names):
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[number] = max(moved[number] + sign * steps[number], 0.0)
            trials.append(Trial(f"{name} {sign:+.0f}", _tuple(moved), num_runs, first_run=first_run))
    return trials


def slopes_of(layout: ParameterLayout, tallies: Mapping[str, DriveTallies], cells: Sequence[Cell]) -> Slopes:
    """Return the slopes that parameter trials show."""
    size = (len(cells), len(layout.names))
    slope, error = np.zeros(size), np.zeros(size)
    influence = [paired_difference(tallies[BASELINE], tallies[BASELINE], cells)[2]]
    for column, name in enumerate(layout.names):
        up, down = tallies[f"{name} +1"], tallies[f"{name} -1"]
        difference, noise, own = paired_difference(up, down, cells)
        other = paired_difference(down, up, cells)[2]
        slope[:, column] = 0.5 * difference
        error[:, column] = np.where(np.isfinite(noise), 0.5 * noise, 0.0)
        influence += [own, other]
    return Slopes(slope, error, np.vstack(influence))


def told_by_parameters(effect: Effect, layout: ParameterLayout) -> tuple[str, ...]:
    """Return the calibrated parameters whose values are all that an effect is; nothing where it is something else.

    More of lcKeepRight is no effect where lcKeepRight is calibrated: the simulation lacks nothing, its value is wrong.
    """
    attributes = tuple(attribute for attribute, _ in effect.vtype_attributes)
    return attributes if set(attributes) <= set(layout.attributes) else ()


def effects_to_try(layout: ParameterLayout) -> tuple[Effect, ...]:
    """Return the effects that are something else than values of calibrated parameters."""
    return tuple(effect for effect in EFFECTS if not effect.is_calibrated and not told_by_parameters(effect, layout))


def effect_trials(
    values: np.ndarray,
    num_runs: int,
    windows: Mapping[str, Sequence[Window]],
    effects: Sequence[Effect] | None = None,
) -> list[EffectTrial]:
    """Return the trials of the effects that the surrogate shows, medium and strong; local ones in their windows.

    Args:
        values: parameter values.
        num_runs: runs of each trial.
        windows: where local effects are tried, by effect.
        effects: which ones; all of the registry unless given.
    """
    trials = []
    for effect in EFFECTS if effects is None else effects:
        if effect.is_sensor_s or effect.is_calibrated:
            continue
        is_everywhere = effect.searched_at is SearchedAt.EVERYWHERE
        for window in (None,) if is_everywhere else windows.get(effect.name, ()):
            for strength in effect_strengths(effect, window):
                setting = window.effect_setting(strength) if window else EffectSetting(strength)
                name = f"{effect.name} {strength:g} {window}"
                trial = Trial(name, _tuple(values), num_runs, {effect.name: setting})
                trials.append(EffectTrial(effect, strength, window, trial))
    return trials


def effect_strengths(effect: Effect, window: Window | None) -> tuple[float, ...]:
    """Strengths at which an effect is tried; everywhere in both directions, where it has two."""
    if effect.lasts_as_strength and window is not None and window.from_s is not None and window.to_s is not None:
        return (window.to_s - window.from_s,)
    signs = (1.0,)
    if effect.is_signed:
        signs = (1.0, -1.0) if window is None else (effect.slows * window.sign,)
    return tuple(sign * size for sign in signs for size in (effect.medium, effect.strong))


def disagreement(surrogate: DriveTallies, sumo: DriveTallies, null: NullModel) -> np.ndarray:
    """Return by how much the surrogate's features differ from SUMO's at equal values, beyond chance, in units of noise.

    A feature in which they differ answers to an effect in another way, too: what the surrogate has too much of goes
    with any effect that takes it away, and is not there in SUMO.
    """
    shift, error = measured_shift(surrogate, sumo, null)
    return np.sqrt(np.maximum(shift**2 - error**2, 0.0))


def surrogate_signatures(
    trials: Sequence[EffectTrial], tallies: Mapping[str, DriveTallies], null: NullModel, disagrees: np.ndarray
) -> dict[str, list[Signature]]:
    """Return the signatures that trials show, by effect, in units of noise; a trial whose runs failed shows none.

    Each feature may be wrong by what both simulators disagree by without any effect.
    """
    groups: dict[tuple[str, Window | None, bool], list[EffectTrial]] = {}
    for tried in trials:
        if not has_pairs(tallies[tried.trial.name], tallies[BASELINE]):
            continue
        groups.setdefault((tried.effect.name, tried.window, tried.strength < 0.0), []).append(tried)
    signatures: dict[str, list[Signature]] = {}
    for (name, window, _), members in groups.items():
        rows = [paired_difference(tallies[m.trial.name], tallies[BASELINE], null.cells)[:2] for m in members]
        rows = [(shift, np.hypot(error, disagrees * null.deviation)) for shift, error in rows]
        setting = window.setting() if window else {}
        signature = _signature(name, setting, [m.strength for m in members], rows, null)
        signatures.setdefault(name, []).append(signature)
    return signatures


def altered_signatures(
    runs: NullRuns, null: NullModel, behaviour: Mapping[str, list[Signature]]
) -> dict[str, list[Signature]]:
    """Return the signatures that altered SUMO runs show.

    Sensor effects are exact there. Effects with a rhythm get their identities from there and the rest from the
    surrogate; each rhythm is a signature of its own, for it does not lie between two others.
    """
    signatures: dict[str, list[Signature]] = {}
    names = dict.fromkeys(name for name, _ in runs.altered)
    for name in (name for name in names if effect_named(name).is_sensor_s):
        strengths = sorted(strength for effect, strength in runs.altered if effect == name)
        for sign in (1.0, -1.0):
            chosen = [strength for strength in strengths if sign * strength > 0]
            chosen.sort(key=abs)
            if chosen:
                rows = [_altered(runs, name, strength, null) for strength in chosen]
                signature = _signature(name, {}, chosen, rows, null, altered_exactness(name, null.cells))
                signatures.setdefault(name, []).append(signature)
    is_identity = np.asarray([cell.channel == Channel.IDENTITY for cell in null.cells])
    for name in (name for name in names if not effect_named(name).is_sensor_s):
        strengths = sorted(strength for effect, strength in runs.altered if effect == name)
        for strength in strengths:
            shift, error = _altered(runs, name, strength, null)
            shift, error = shift / null.deviation, error / null.deviation
            for in_traffic in behaviour.get(name, ()):
                traffic, noise = in_traffic.at(strength)
                both = np.where(is_identity, shift, traffic)
                noises = np.where(is_identity, error, noise)
                grid = np.asarray([0.0, strength])
                zero = np.zeros_like(both)
                shown = is_identity | in_traffic.is_shown
                shifts, errors = np.stack([zero, both]), np.stack([zero, noises])
                one = Signature(name, {}, grid, shifts, errors, is_fixed=True, is_shown=shown)
                signatures.setdefault(name, []).append(one)
    return signatures


def altered_exactness(name: str, cells: Sequence[Cell]) -> np.ndarray:
    """Exactness of a sensor effect's signature in each feature."""
    reading = effect_named(name).reading
    is_reading = [reading is not None and cell.reads == reading for cell in cells]
    return np.where(is_reading, READING_EXACTNESS, ALTERED_EXACTNESS)


def _altered(runs: NullRuns, name: str, strength: float, null: NullModel) -> tuple[np.ndarray, np.ndarray]:
    shift, error, _ = paired_difference(runs.altered[name, strength], runs.plain, null.cells)
    return shift, error


def _signature(
    name: str,
    setting: Mapping[str, float],
    strengths: Sequence[float],
    rows: Sequence[tuple[np.ndarray, np.ndarray]],
    null: NullModel,
    exactness: float | np.ndarray = 1.0,
) -> Signature:
    zero = np.zeros(len(null.cells))
    shift = np.stack([zero, *(row[0] / null.deviation for row in rows)])
    error = np.stack([zero, *(np.where(np.isfinite(row[1]), row[1], 0.0) / null.deviation for row in rows)])
    sign = float(np.sign(strengths[0]))
    sizes = np.abs([0.0, *strengths])
    is_shown = np.all([np.isfinite(row[1]) for row in rows], axis=0)
    is_fixed = effect_named(name).lasts_as_strength
    return Signature(name, setting, sizes, shift, error, exactness, sign, is_fixed, is_shown)


def _tuple(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
