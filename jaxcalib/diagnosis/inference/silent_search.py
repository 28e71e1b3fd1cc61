"""Looks in the surrogate for silent values that explain the drives, by one fitted surface after another.

A surface of second order without products is poor over all that a weight of lane changes can be. So where the first
one leads, the runs there are the new ground, and the next one covers half as much around it: the steps of a response
surface study. A step that the surrogate's own runs do not confirm is not taken.

Source: Box & Wilson (1951), J. R. Stat. Soc. B 13, 1.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.silent_values import FittedAnswer, OpenValues, likeliest_values, log_evidence_of
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.trials import Trial, has_pairs, paired_difference

MOST_SURFACES = 3
NARROWER = 0.5  # the next surface's width over that of the last one

Values = np.ndarray
RunTrials = Callable[[str, Sequence[Trial]], Mapping[str, DriveTallies]]


@dataclass(frozen=True)
class Found:
    """Where surfaces led."""

    values: Values  # parameter values
    gain: float  # log evidence of the drives above the values where the search began, less the price of looking
    num_moves: int  # how often values were moved


@dataclass(frozen=True)
class SilentSearch:
    """What a search needs of the simulation that it begins at."""

    null: NullModel  # null model there
    run: RunTrials  # makes trials in the surrogate; the name of a part and its trials -> tallies by name
    num_runs: int  # of the surrogate at each point of a surface
    num_confirming: int  # of the surrogate where a surface leads
    seed: int

    def search(self, open_values: OpenValues, difference: np.ndarray, here: DriveTallies) -> Found:
        """Return where surfaces lead.

        Args:
            open_values: where to begin, and what is open.
            difference: of the drives from the simulation there, in units of noise.
            here: the surrogate's runs there.
        """
        price = float(np.log(max(open_values.num_points, 1)))  # each point had its chance
        values, gain = open_values.values, 0.0
        for number in range(MOST_SURFACES):
            candidates = self._candidates(open_values, difference, here, number)
            if not candidates:
                return Found(values, gain, number)
            confirmed = [self._confirmed(point, difference, here) for point in candidates]
            best = max(range(len(candidates)), key=lambda each: confirmed[each][0])
            more, shift, there = confirmed[best]
            if more - price <= 0.0:
                return Found(values, gain, number)
            values, gain = candidates[best], gain + more - price
            difference, here = difference - shift, there
            open_values = _around(values, open_values)
        return Found(values, gain, MOST_SURFACES)

    def _candidates(
        self, open_values: OpenValues, difference: np.ndarray, here: DriveTallies, number: int
    ) -> list[Values]:
        """Return where a surface leads, and the best of its points; nothing where neither promises anything."""
        points = open_values.spread(open_values.num_points, self.seed + number)
        tallies = self._run(f"silent {number}", points, self.num_runs)
        shown = [(point, *self._shift(there, here)) for point, there in tallies if has_pairs(there, here)]
        answer = FittedAnswer.to_runs(
            open_values, [point for point, _, _ in shown],
            [np.where(np.isfinite(error), shift, np.nan) for _, shift, error in shown],
        )  # fmt: skip
        candidates = []
        if answer is not None:
            point, gain = likeliest_values(answer, difference, self.null, self.seed + number)
            if gain <= LEAST_EVIDENCE:
                return []  # where features answer to nothing, the best of many points is chance
            candidates.append(point)
            candidates.append(max(shown, key=lambda each: log_evidence_of(difference, self.null, *each[1:]))[0])
        return candidates

    def _confirmed(
        self, point: Values, difference: np.ndarray, here: DriveTallies
    ) -> tuple[float, np.ndarray, DriveTallies]:
        """Return the log evidence for a point above the present one, what features do there, and its runs."""
        ((_, there),) = self._run("confirmed", [point], self.num_confirming)
        if not has_pairs(there, here):
            return -np.inf, np.zeros_like(difference), there
        shift, error = self._shift(there, here)
        known = np.where(np.isfinite(error), shift, 0.0)
        return log_evidence_of(difference, self.null, known, error), known, there

    def _shift(self, there: DriveTallies, here: DriveTallies) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much features differ, in units of noise, and its standard error; inf where it is not known."""
        shift, error, _ = paired_difference(there, here, self.null.cells)
        return shift / self.null.deviation, error / self.null.deviation

    def _run(self, part: str, points: Sequence[Values], num_runs: int) -> list[tuple[Values, DriveTallies]]:
        trials = [
            Trial(f"silent {point.tolist()!r}, {num_runs} runs", tuple(point.tolist()), num_runs) for point in points
        ]
        tallies = self.run(part, trials)
        return [(point, tallies[trial.name]) for point, trial in zip(points, trials, strict=True)]


def _around(values: Values, open_values: OpenValues) -> OpenValues:
    """Return what is open around some values: half as much as before, within what was."""
    reach = 0.5 * NARROWER * (open_values.high - open_values.low)
    low, high = np.maximum(open_values.low, values - reach), np.minimum(open_values.high, values + reach)
    return replace(open_values, values=values, low=low, high=high)
