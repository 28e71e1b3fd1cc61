"""Whether the simulation makes the encounters that the field has, and no others: recall, precision and F1.

Encounters of one kind and severity are alike. Of the field's, a round of simulated drives recalls as many as it has of
the same kind and severity itself; of its own it is precise in as many as the field has. Rounds hold as many drives as
the field, and what they say of each other is what a right simulation reaches: few encounters leave much to chance.

Source: precision, recall and their harmonic mean, van Rijsbergen (1979), Information Retrieval, ch. 7, for counted
events as intersections of histograms, Swain & Ballard (1991), Int. J. Comput. Vis. 7, eq. 1.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.encounters import KINDS, SEVERITIES, encounter_tally
from jaxcalib.validation.observer import ObservedDrives

ALL = "all"
LOWEST_SHARE = 0.05  # of right simulations have a lower F1 than the limit


def compare_encounters(
    tally_names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives
) -> dict[str, dict[str, Any]]:
    """Return how well encounters are recalled, by kind and for all kinds together.

    Args:
        tally_names: names of the tallies.
        field: the field's drives, [drive].
        rounds: rounds of as many simulated ones, [round, drive].

    Returns:
        By kind: counts `field` and `simulated` (mean over rounds) by severity, null for all kinds; `recall`,
        `precision` and `f1` (means over rounds; null where there is nothing to recall); and the F1 of each round
        against all others: their mean, `among_simulated`, and the `limit` below which at most one right simulation
        in twenty lies, null for fewer than 19 rounds.
    """
    number = {name: index for index, name in enumerate(tally_names)}
    kinds: dict[str, list[str]] = {kind: [kind] for kind in KINDS} | {ALL: list(KINDS)}
    table = {}
    for name, several in kinds.items():
        places = [number[encounter_tally(kind, severity)] for kind in several for severity in SEVERITIES]
        real, simulated = field.tally[:, places].sum(axis=0), rounds.tally[:, :, places].sum(axis=1)
        recall, precision, f1 = _scores(real, simulated)
        count = len(simulated)
        among = [_scores(simulated[one], simulated[np.arange(count) != one])[2] for one in range(count)]
        known = np.asarray([value for value in among if np.isfinite(value)])
        is_one_kind = name != ALL
        table[name] = {
            "field": _by_severity(real) if is_one_kind else None,
            "simulated": _by_severity(simulated.mean(axis=0)) if is_one_kind else None,
            "recall": rounded(recall),
            "precision": rounded(precision),
            "f1": rounded(f1),
            "among_simulated": rounded(float(known.mean())) if len(known) else None,
            "limit": _limit(known),
        }
    return table


def _limit(f1: Float[np.ndarray, " round"]) -> float | None:
    """The order statistic below which one more of as many falls at most so often; None where none does."""
    place = int(LOWEST_SHARE * (len(f1) + 1))
    return rounded(float(np.sort(f1)[place - 1])) if place else None


def _by_severity(counts: Float[np.ndarray, " severity"]) -> dict[str, float | None]:
    return {severity: rounded(float(count)) for severity, count in zip(SEVERITIES, counts, strict=True)}


def _scores(real: Float[np.ndarray, " cell"], simulated: Float[np.ndarray, "round cell"]) -> tuple[float, float, float]:
    """Return recall, precision and F1, means over rounds; nan where neither has any encounter."""
    shared, had, made = np.minimum(real, simulated).sum(axis=1), real.sum(), simulated.sum(axis=1)
    both = had + made
    f1 = 2.0 * shared[both > 0] / both[both > 0]
    precise = shared[made > 0] / made[made > 0]
    return (
        float(shared.mean() / had) if had > 0 else float("nan"),
        float(precise.mean()) if len(precise) else float("nan"),
        float(f1.mean()) if len(f1) else float("nan"),
    )
