"""Which runs a sweep makes, in which order, and in which blocks they are kept."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from jaxcalib.errors import CaseError
from jaxcalib.sweeps.design import Design
from sim_adapters.interface import DriveStart, RunRequest

Engine = Literal["surrogate", "sumo"]
ENGINES: tuple[Engine, ...] = ("surrogate", "sumo")
BLOCK_ROWS: dict[Engine, int] = {"surrogate": 64, "sumo": 16}
MOST_BLOCKS = 2048  # one file each until they are merged


@dataclass(frozen=True)
class Shard:
    """The part of a sweep that one of several jobs makes."""

    number: int = 1  # of the job, from 1
    count: int = 1  # number of jobs

    def has(self, block: int) -> bool:
        """Return whether the job makes a block."""
        return block % self.count == self.number - 1

    def __str__(self) -> str:
        """Return it as on the command line."""
        return f"{self.number}/{self.count}"


def read_shard(text: str) -> Shard:
    """Return the shard that a text such as "3/8" means.

    Raises:
        CaseError: it means none.
    """
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise CaseError("command line", "--shard", f"expected i/n with i from 1 to n, for example 3/8; got {text!r}.")
    return Shard(int(number), int(count))


@dataclass(frozen=True)
class SweepPlan:
    """All runs of a sweep, one candidate after another, each on all seeds."""

    engine: Engine  # name of the simulator
    design: Design  # parameter sets
    num_seeds: int  # runs of each
    first_seed: int  # seed of each candidate's first run; the next has the next
    starts: tuple[DriveStart, ...]  # which the runs of a candidate take in turn

    @property
    def num_rows(self) -> int:
        """Runs in all."""
        return len(self.design.values) * self.num_seeds

    @property
    def block_rows(self) -> int:
        """Runs that are kept together; the same on every machine, for blocks are what jobs share out."""
        rows = BLOCK_ROWS[self.engine]
        while rows * MOST_BLOCKS < self.num_rows:
            rows *= 2
        return rows

    @property
    def num_blocks(self) -> int:
        """Number of blocks."""
        return -(-self.num_rows // self.block_rows)

    def rows_of(self, block: int) -> range:
        """Return the numbers of the runs of a block."""
        begin = block * self.block_rows
        return range(begin, min(begin + self.block_rows, self.num_rows))

    def candidates(self, block: int) -> list[int]:
        """Return the candidate of each run of a block."""
        return [row // self.num_seeds for row in self.rows_of(block)]

    def requests(self, block: int) -> list[RunRequest]:
        """Return the runs of a block."""
        return list(self._requests(block))

    def _requests(self, block: int) -> Iterator[RunRequest]:
        for row in self.rows_of(block):
            candidate, number = divmod(row, self.num_seeds)
            own = self.starts[number % len(self.starts)]
            yield RunRequest(
                values=tuple(self.design.values[candidate].tolist()),
                seed=self.first_seed + number,
                depart_s=own.depart_s,
                drive=own.drive,
            )
