"""Keeps the trials of a diagnosis: each is made once, whoever asks for it."""

from collections.abc import Callable, Mapping, Sequence

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.trials import Trial, TrialRunner


class TrialBook:
    """Makes trials in the surrogate and knows the tallies of all that were made."""

    def __init__(
        self,
        runner: TrialRunner,
        parts: FinishedParts,
        key: str,
        known: Mapping[str, DriveTallies],
        on_runs: Callable[[int], None],
    ) -> None:
        """Begin with the trials that are known, by name; the key tells this baseline from others."""
        self._runner, self._parts, self._key, self._on_runs = runner, parts, key, on_runs
        self._tallies = dict(known)

    def run(self, part: str, trials: Sequence[Trial]) -> Mapping[str, DriveTallies]:
        """Make the trials that are not known yet, and return the tallies of all that are, by name."""
        fresh = [trial for trial in trials if trial.name not in self._tallies]
        if fresh:
            name = f"{part} {self._key} {[trial.name for trial in fresh]!r}"
            self._tallies |= self._parts.tallies(name, lambda: self._runner.run(fresh, self._on_runs))
        return dict(self._tallies)

    @property
    def num_runs(self) -> int:
        """How many runs all trials took."""
        return sum(len(tallies) for tallies in self._tallies.values())
