"""Which drives the runs of a candidate, a null or a trial stand for: each as often as the others."""

from collections.abc import Sequence

from sim_adapters.interface import DriveStart


def in_rounds(starts: Sequence[DriveStart], num_runs: int) -> int:
    """Return a number of runs near the wanted one in which each of some departures occurs equally often."""
    per_round = len(interleaved(starts))
    return max(1, round(num_runs / per_round)) * per_round


def interleaved(starts: Sequence[DriveStart]) -> list[DriveStart]:
    """Return drives as runs take them in turn: alike ones once, those at one time apart; uneven ones as they come."""
    if not _is_even(starts):
        return list(starts)
    ordered = sorted(set(starts))
    earlier = [sum(other.depart_s == one.depart_s for other in ordered[:place]) for place, one in enumerate(ordered)]
    return [one for _, one in sorted(zip(earlier, ordered, strict=True))]


def _is_even(starts: Sequence[DriveStart]) -> bool:
    counts = [starts.count(one) for one in set(starts)]
    return min(counts) == max(counts)
