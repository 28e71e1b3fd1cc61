"""Stretches of long records, for a first look at many points.

A stretch begins anew where the recorded follower was, so stretches of one record stand side by side as pairs of their
own: a drive of 19 minutes takes as many steps as one of 51 seconds, and a few stretches tell good points from bad ones
as well as the whole does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from jaxcalib.pair_fitting.batch import PIECE_STEPS, recorded_gap_m
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair

MOST_STRETCHES = 4  # of a pair


@dataclass(frozen=True)
class Stretches:
    """Stretches of pairs."""

    parts: list[RecordedPair]  # the stretches, each as a pair
    pair: Int[np.ndarray, " stretch"]  # place of the pair that each belongs to
    weight: Float[np.ndarray, " stretch"]  # of the square of its mixed error in that of the pair

    def summed(self, total: Float[np.ndarray, "point stretch"]) -> Float[np.ndarray, "point pair"]:
        """Return what the misfits of stretches come to for each pair."""
        of_pair = np.zeros((self.pair[-1] + 1, len(total)))
        np.add.at(of_pair, self.pair, (total * self.weight).T)
        return of_pair.T


def stretches_of(pairs: Sequence[RecordedPair]) -> Stretches:
    """Return stretches of about 512 steps, evenly spread over each pair; all of it if it is short."""
    parts: list[RecordedPair] = []
    owners: list[int] = []
    weights: list[float] = []
    for place, pair in enumerate(pairs):
        number = max(1, round(len(pair) / PIECE_STEPS))
        edges = np.linspace(0, len(pair), number + 1).astype(int).tolist()
        kept = min(number, MOST_STRETCHES)
        for index in ((np.arange(kept) + 0.5) * number / kept).astype(int).tolist():
            part = pair.part(edges[index], edges[index + 1])
            parts.append(part)
            owners.append(place)
            weights.append(recorded_gap_m(part).sum() / recorded_gap_m(pair).sum())
    return Stretches(parts, np.asarray(owners), np.asarray(weights))
