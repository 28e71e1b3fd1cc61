"""Recorded leader-follower pairs: read, checked, on an even clock."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxcalib.errors import CaseError, quote
from jaxcalib.field.size_limit import OF_RECORDINGS
from jaxcalib.field.table_files import read_columns, row_place

STEP_S = 0.1
COLUMNS = ("time_s", "v_lead_mps", "v_foll_mps", "gap_m")
FEWEST_STEPS = 100
LONGEST_INTERVAL_S = 1.0


@dataclass(frozen=True)
class RecordedPair:
    """A follower and its leader, every 0.1 s."""

    name: str  # the pair's id
    leader_mps: Float[np.ndarray, " step"]  # the leader's speed
    follower_mps: Float[np.ndarray, " step"]  # the follower's speed
    gap_m: Float[np.ndarray, " step"]  # leader's rear bumper less follower's front bumper

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.gap_m)

    def part(self, begin: int, end: int) -> "RecordedPair":
        """Return some of the steps."""
        return RecordedPair(self.name, self.leader_mps[begin:end], self.follower_mps[begin:end], self.gap_m[begin:end])

    @property
    def leader_advance_m(self) -> Float[np.ndarray, " step"]:
        """How far the leader gets in each step, so that gap and follower's speed agree; 0 in the last.

        The leader's place is the follower's, integrated as simulations move vehicles, plus the gap: errors of two
        positioning systems do not add up.
        """
        return np.append(STEP_S * self.follower_mps[1:] + np.diff(self.gap_m), 0.0)


def read_pairs(file: Path, drops_bad: bool = False) -> tuple[list[RecordedPair], list[str]]:
    """Read pairs from a table with the columns pair_id, time_s, v_lead_mps, v_foll_mps and gap_m.

    Args:
        file: .csv, .csv.gz or .parquet.
        drops_bad: whether pairs that cannot be followed are left out instead of ending the program.

    Returns:
        The pairs, and why others were left out.

    Raises:
        CaseError: the table or a pair in it is wrong; one line says what.
    """
    table = read_columns(file, {"pair_id": "text", **dict.fromkeys(COLUMNS, "number")}, OF_RECORDINGS)
    index, words = table.texts["pair_id"]
    pairs, dropped = [], []
    for word in range(len(words)):
        rows = np.flatnonzero(index == word)
        if not len(rows):
            continue
        try:
            pairs.append(_pair(file, words[word], rows, {name: table.numbers[name][rows] for name in COLUMNS}))
        except CaseError as error:
            if not drops_bad:
                raise
            dropped.append(f"{words[word]}: {error.expected}")
    if not pairs:
        raise CaseError(file, "", "expected at least one pair that can be followed.")
    return pairs, dropped


def _pair(file: Path, name: str, rows: np.ndarray, numbers: dict[str, np.ndarray]) -> RecordedPair:
    place = f"pair {quote(name)}, "
    for column in COLUMNS:
        missing = np.flatnonzero(~np.isfinite(numbers[column]))
        if len(missing):
            where = place + row_place(int(rows[missing[0]]), column)
            raise CaseError(file, where, "expected a number; a pair needs its leader at all times.")
    time_s = numbers["time_s"]
    backwards = np.flatnonzero(np.diff(time_s) <= 0.0)
    if len(backwards):
        raise CaseError(file, place + row_place(int(rows[backwards[0] + 1])), "expected time to run forwards.")
    closed = np.flatnonzero(numbers["gap_m"] <= 0.0)
    if len(closed):
        where = place + row_place(int(rows[closed[0]]), "gap_m")
        raise CaseError(file, where, f"expected a gap above 0, got {numbers['gap_m'][closed[0]]:g}.")
    longest = np.diff(time_s).max() if len(time_s) > 1 else np.inf
    if longest > LONGEST_INTERVAL_S:
        raise CaseError(
            file, place[:-2], f"expected a row at least every {LONGEST_INTERVAL_S:g} s, found {longest:g} s."
        )
    clock = np.arange(time_s[0], time_s[-1] + 0.5 * STEP_S, STEP_S)
    if len(clock) < 2 * FEWEST_STEPS:
        raise CaseError(file, place[:-2], f"expected at least {2 * FEWEST_STEPS * STEP_S:g} s.")
    even = {column: np.interp(clock, time_s, numbers[column]) for column in COLUMNS[1:]}
    return RecordedPair(name, np.maximum(even["v_lead_mps"], 0.0), np.maximum(even["v_foll_mps"], 0.0), even["gap_m"])
