"""Makes the trials of attacks that are not there yet, and tabulates all that are."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.faults.attack import Attack, Ground, Trial
from experiments.faults.kept_trials import KeptTrials

CASE, TRIALS, GROUND = "case", "trials", "ground"
MOST_NAMED = 20  # failures that notes name


def make_trials(
    attacks: Mapping[str, Attack], out: Path, number: int | None, seed: int, tell: Callable[[str, Trial], None]
) -> dict[str, list[Trial]]:
    """Make what is missing of attacks' trials, and return all of them.

    Args:
        attacks: by name.
        out: folder that keeps them.
        number: of trials of each attack; what is usual for it if None.
        seed: of all random numbers.
        tell: told of each trial as soon as it is made.
    """
    made: dict[str, list[Trial]] = {}
    for name, attack in attacks.items():
        kept = KeptTrials(out / TRIALS / name, attack, seed)
        numbers = attack.numbers(number)
        found = {place: trial for place, trial in kept.read().items() if place in numbers}
        ground = Ground(out / GROUND / name, out / CASE, seed)
        ground.folder.mkdir(parents=True, exist_ok=True)
        if missing := [place for place in numbers if place not in found]:
            for trial in attack.trials(ground, missing):
                kept.write(trial)
                found[trial.number] = trial
                tell(name, trial)
        made[name] = [found[place] for place in sorted(found)]
    return made


def kept_trials(attacks: Mapping[str, Attack], out: Path, seed: int) -> dict[str, list[Trial]]:
    """Return the trials of attacks that are there, without making any; attacks without are left out."""
    found = {name: KeptTrials(out / TRIALS / name, attack, seed).read() for name, attack in attacks.items()}
    return {name: [trials[place] for place in sorted(trials)] for name, trials in found.items() if trials}


def table_of(attacks: Mapping[str, Attack], made: Mapping[str, Sequence[Trial]]) -> list[dict[str, Any]]:
    """Return a row for each attack."""
    rows: list[dict[str, Any]] = []
    for name, trials in made.items():
        ran = [trial for trial in trials if trial.ending != "not run"]
        peaks_mb = [trial.peak_mb for trial in ran if trial.peak_mb is not None]
        rows.append(
            {
                "attack": name,
                "asked": attacks[name].asks,
                "trials": len(ran),
                "passed": sum(trial.ending == "passed" for trial in ran),
                "failed": sum(trial.ending == "failed" for trial in ran),
                "longest, s": round(max((trial.wall_s for trial in ran), default=0.0), 1),
                "most memory, MB": round(max(peaks_mb)) if peaks_mb else None,
                "not run": len(trials) - len(ran),
            }
        )
    return rows


def failures_of(made: Mapping[str, Sequence[Trial]]) -> list[str]:
    """Return a line for each trial that failed, and for each that could not be made."""
    return [
        f"{name} {trial.number}: {trial.ending}: {trial.name}: {trial.happened}"
        for name, trials in made.items()
        for trial in trials
        if trial.ending != "passed"
    ]


def notes_of(made: Mapping[str, Sequence[Trial]], seed: int) -> list[str]:
    """Return what stands below the table."""
    lines = failures_of(made)
    more = [f"- and {len(lines) - MOST_NAMED} more"] if len(lines) > MOST_NAMED else []
    return [f"Seed {seed}.", *(f"- {line}" for line in lines[:MOST_NAMED]), *more]
