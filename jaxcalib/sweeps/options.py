"""What a user asks of a sweep."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.seeds import MOST_SEED
from jaxcalib.sweeps.plan import ENGINES, Engine, Shard, read_shard

MOST_SEEDS = 100_000


@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """Options of a sweep; see `sweep`."""

    design: str = "sobol:1024"
    seeds: int = 4
    engine: Engine = "surrogate"
    seed: int = 0
    parameters: Sequence[str] | None = None
    settings: Settings | Path | None = None
    shard: Shard | str | None = None
    cluster: str | None = None
    resume: bool = False

    @property
    def is_whole(self) -> bool:
        """Whether one call makes all rows, and the table."""
        return self.shard is None

    @property
    def part(self) -> Shard:
        """The part of the rows that a call makes."""
        return read_shard(self.shard) if isinstance(self.shard, str) else self.shard or Shard()

    def check(self) -> None:
        """Refuse what no sweep can be.

        Raises:
            CaseError: an option is out of its range.
        """
        _ = self.part
        if self.engine not in ENGINES:
            known = ", ".join(ENGINES)
            raise CaseError("command line", "--engine", f"expected one of {known}; got {quote(self.engine)}.")
        if not 1 <= self.seeds <= MOST_SEEDS:
            raise CaseError("command line", "--seeds", f"expected 1 to {MOST_SEEDS}, got {self.seeds}.")
        if not 0 <= self.seed <= MOST_SEED:
            raise CaseError("command line", "--seed", f"expected 0 to {MOST_SEED}, got {self.seed}.")
