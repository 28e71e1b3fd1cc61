"""Diagnostic features: quotients of tallies that add up over drives, each with the cell that it describes."""

import enum
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from surrogate.effects.base import Reading, SearchedAt

SMALLEST = 1e-9
EVENT = 1.0
ROWS_PER_EVENT = 20.0  # a vehicle that shows something shows it in some 20 rows, 10 s, in a row


class Channel(enum.StrEnum):
    """By what a feature compares a drive with the simulation."""

    IDENTITY = "identity"
    REPLAY = "replay"
    CLOSED_LOOP = "closed_loop"


class Cell(NamedTuple):
    """What a feature describes, and how it is judged; nothing depends on how measure and regime are spelt."""

    channel: Channel  # by what it compares
    measure: str  # name with its unit as suffix
    regime: str = ""  # state of the traffic or time since an event; empty for all
    role: str = "background"  # subject or background
    lane: int | None = None  # counted from the left, 1 is the leftmost; None for all
    from_m: float | None = None  # begin of the stretch of route; None for all
    to_m: float | None = None  # its end
    from_s: float | None = None  # begin of the time; None for all
    to_s: float | None = None  # its end
    is_logarithmic: bool = False  # whether its logarithm is judged: for what cannot be negative and varies by factors
    # standard deviation that stays open whatever the number of runs, in the feature's unit or in natural
    # logarithms; above 0 for what holds in every drive but for rounding and integration
    tolerance: float = 0.0
    rows_per_event: float = 0.0  # how many counted rows are one event; 0 where its numerator counts none
    locates: SearchedAt | None = None  # windows of which kind of local effect it tells; None for none
    reads: Reading | None = None  # what of an effect's strength it reads from the log itself; None for nothing

    @classmethod
    def from_json(cls, values: Sequence[Any]) -> "Cell":
        """Return the cell that JSON keeps as a list."""
        cell = cls(*values)
        return cell._replace(
            channel=Channel(cell.channel),
            locates=None if cell.locates is None else SearchedAt(cell.locates),
            reads=None if cell.reads is None else Reading(cell.reads),
        )

    def within(self, from_m: float, to_m: float) -> "Cell":
        """Return the same on a stretch of route."""
        return self._replace(from_m=float(from_m), to_m=float(to_m))

    @property
    def words(self) -> str:
        """What it describes, for people; without place and time."""
        parts = [self.measure.replace("_", " "), self.regime, "subject vehicle" if self.role == "subject" else ""]
        if self.lane is not None:
            parts.append(f"lane {self.lane} from the left")
        return ", ".join(part for part in parts if part)

    @property
    def name(self) -> str:
        """A name that tells it from all others."""
        parts = [self.channel, self.measure, self.regime, self.role]
        if self.lane is not None:
            parts.append(f"lane {self.lane}")
        if self.from_m is not None:
            parts.append(f"{self.from_m:.0f}-{self.to_m:.0f} m")
        if self.from_s is not None:
            parts.append(f"{self.from_s:.0f}-{self.to_s:.0f} s")
        return " | ".join(part for part in parts if part)


class TallyBook:
    """Collects the tallies of one drive."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.sums: dict[Cell, tuple[float, float]] = {}

    def quotient(self, cell: Cell, above: float, below: float) -> None:
        """Enter a feature's two tallies."""
        self.sums[cell] = (float(above), float(below))

    def mean(self, cell: Cell, values: np.ndarray, chosen: np.ndarray) -> None:
        """Enter the mean of a quantity over chosen rows."""
        self.sums[cell] = (float(values[chosen].sum()), float(chosen.sum()))


@dataclass(frozen=True)
class DriveTallies:
    """Tallies of several drives."""

    cells: tuple[Cell, ...]  # the features
    above: np.ndarray  # numerators, [drive, feature]
    below: np.ndarray  # denominators, [drive, feature]
    depart_s: np.ndarray  # when each drive's subject vehicle departs
    run: np.ndarray | None = None  # number of the run that holds each drive; None where each has a run of its own

    def __len__(self) -> int:
        """Return the number of drives."""
        return len(self.above)

    def take(self, drives: np.ndarray | Sequence[int]) -> "DriveTallies":
        """Return some of the drives."""
        run = None if self.run is None else self.run[drives]
        return DriveTallies(self.cells, self.above[drives], self.below[drives], self.depart_s[drives], run)

    def without_each(self) -> list["DriveTallies"]:
        """Return the drives without each of them in turn."""
        return [self.take(np.delete(np.arange(len(self)), drive)) for drive in range(len(self))]

    def keep(self, features: np.ndarray) -> "DriveTallies":
        """Return some of the features."""
        cells = tuple(cell for cell, kept in zip(self.cells, features, strict=True) if kept)
        return DriveTallies(cells, self.above[:, features], self.below[:, features], self.depart_s, self.run)

    @property
    def is_logarithmic(self) -> np.ndarray:
        """Whether the logarithm of each feature is judged."""
        return np.asarray([cell.is_logarithmic for cell in self.cells], bool)

    @property
    def tolerance(self) -> np.ndarray:
        """Standard deviation of each feature that stays open whatever the number of runs."""
        return np.asarray([cell.tolerance for cell in self.cells], float)

    @property
    def rows_per_event(self) -> np.ndarray:
        """How many counted rows of each feature are one event; 0 where it counts none."""
        return np.asarray([cell.rows_per_event for cell in self.cells], float)

    @property
    def num_runs(self) -> int:
        """How many runs hold the drives."""
        return len(self) if self.run is None else len(np.unique(self.run))

    def of_runs(self, values: np.ndarray) -> np.ndarray:
        """Return the sum over the drives of each run, [run, feature], of values of drives, [drive, feature]."""
        if self.run is None:
            return values
        names, place = np.unique(self.run, return_inverse=True)
        sums = np.zeros((len(names), values.shape[1]))
        np.add.at(sums, place, values)
        return sums

    @property
    def num_independent(self) -> float:
        """How many drives with a run of their own would make the mean as certain; drives of one run share its jams.

        Source: Kish (1965), Survey Sampling, sec. 5.4; the design effect, over all features alike, since that of one
        feature is as uncertain as its runs are few.
        """
        num_drives, num_runs = len(self), self.num_runs
        if self.run is None or not 1 < num_runs < num_drives:
            return float(num_runs)
        influence = np.nan_to_num(self.influence())
        together = self.of_runs(influence)
        alone = (influence**2).sum(axis=0) * num_drives / (num_drives - 1)
        shared = (together**2).sum(axis=0) * num_runs / (num_runs - 1)
        design_effect = np.mean(shared[alone > 0] / alone[alone > 0]) if np.any(alone > 0) else 1.0
        return num_drives / float(np.clip(design_effect, 1.0, num_drives / num_runs))

    def values(self) -> np.ndarray:
        """Return the features of all drives pooled; nan where nothing was seen."""
        return pooled_values(self.above.sum(axis=0), self.below.sum(axis=0), self.is_logarithmic)

    def influence(self) -> np.ndarray:
        """Influence of each drive on the pooled features, times the number of drives; the mean over drives is 0.

        Source: delta method for ratios of means, e.g. Cochran (1977), Sampling Techniques, ch. 6.
        """
        mean_above, mean_below = self.above.mean(axis=0), self.below.mean(axis=0)
        safe = np.where(mean_below > 0, mean_below, np.nan)
        ratio = mean_above / safe
        moved = (self.above - ratio * self.below) / safe
        return np.where(self.is_logarithmic, moved / np.maximum(ratio, SMALLEST), moved)


def joined_tallies(one: DriveTallies, other: DriveTallies) -> DriveTallies:
    """Return the drives of both, one after the other; what a drive lacks counts as never observed."""
    cells = tuple(dict.fromkeys(one.cells + other.cells))
    above, below = np.zeros((2, len(one) + len(other), len(cells)))
    column = {cell: index for index, cell in enumerate(cells)}
    for tallies, drives in ((one, slice(0, len(one))), (other, slice(len(one), None))):
        columns = [column[cell] for cell in tallies.cells]
        above[drives, columns], below[drives, columns] = tallies.above, tallies.below
    depart_s = np.concatenate([one.depart_s, other.depart_s])
    if one.run is None and other.run is None:
        return DriveTallies(cells, above, below, depart_s)
    first, second = (np.arange(len(each)) if each.run is None else each.run for each in (one, other))
    return DriveTallies(cells, above, below, depart_s, np.concatenate([first, second + first.max(initial=-1) + 1]))


def pooled_values(above: np.ndarray, below: np.ndarray, is_logarithmic: np.ndarray) -> np.ndarray:
    """Return features of pooled tallies; leading axes are allowed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(below > 0, above / below, np.nan)
        return np.where(is_logarithmic, np.log(np.maximum(ratio, SMALLEST)), ratio)


def gather_tallies(
    books: Iterable[TallyBook], depart_s: Sequence[float], run: Sequence[int] | None = None
) -> DriveTallies:
    """Return the tallies of drives; what a drive lacks counts as never observed."""
    books = list(books)
    cells = tuple(dict.fromkeys(cell for book in books for cell in book.sums))
    table = np.asarray([[book.sums.get(cell, (0.0, 0.0)) for cell in cells] for book in books])
    table = table.reshape(len(books), len(cells), 2)  # nothing at all, where all runs failed
    numbers = None if run is None else np.asarray(run, int)
    return DriveTallies(cells, table[..., 0], table[..., 1], np.asarray(depart_s, float), numbers)
