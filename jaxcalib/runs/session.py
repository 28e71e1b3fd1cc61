"""What goes with the work of one command: the folder that keeps it, its seeds, its progress and its time."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from jaxcalib.runs.journal import Journal
from jaxcalib.runs.progress import Progress, Silent
from jaxcalib.runs.run_folder import RunFolder, open_run_folder
from jaxcalib.runs.seeds import SEEDS_PER_CALIBRATION
from jaxcalib.runs.stopwatch import Stopwatch
from sim_adapters.sumo.workers import SumoWorkers


@dataclass(frozen=True)
class Session:
    """What goes with the work of one command."""

    folder: RunFolder  # RUN, which keeps the runs and takes the results
    seed: int  # of all random numbers
    progress: Progress  # told how far the work is
    stopwatch: Stopwatch  # takes the time of each part
    began_s: float  # when the command began, by `time.perf_counter`
    # who makes SUMO's runs; None for processes of this machine
    sumo_workers: SumoWorkers | None = field(default=None, kw_only=True)

    @property
    def journal(self) -> Journal:
        """The runs made so far."""
        return self.folder.journal

    @property
    def first_seed(self) -> int:
        """The least seed of a run; `seeds` says which kinds of runs lie how far behind it."""
        return self.seed * SEEDS_PER_CALIBRATION

    @property
    def elapsed_s(self) -> float:
        """Time since the command began, with that of the runs which the journal replayed."""
        return self.journal.clock() - self.began_s

    def timed_apart(self) -> "Session":
        """Return the same session with a stopwatch of its own, for work whose parts another part's time holds."""
        return replace(self, stopwatch=Stopwatch(self.journal.clock))


@contextmanager
def open_session(
    out: Path | str | None,
    identity: dict[str, str],
    *,
    seed: int = 0,
    progress: Progress | None = None,
    resume: bool = False,
    began_s: float | None = None,
    sumo_workers: SumoWorkers | None = None,
) -> Iterator[Session]:
    """Open RUN for the work of a command, and close it behind it.

    Args:
        out: RUN; None for a folder that goes away with the session.
        identity: what the runs depend on; see `identify`.
        seed: of all random numbers.
        progress: told how far the work is; nobody is, if None.
        resume: whether to go on with what `out` holds.
        began_s: when the command began, by `time.perf_counter`; now, if None.
        sumo_workers: who makes SUMO's runs; processes of this machine, if None.

    Raises:
        CaseError: as `open_run_folder`.
    """
    began_s = time.perf_counter() if began_s is None else began_s
    if out is None:
        with (
            tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder,
            open_session(
                Path(folder) / "run", identity, seed=seed, progress=progress, began_s=began_s, sumo_workers=sumo_workers
            ) as session,
        ):
            yield session
        return
    with open_run_folder(Path(out), identity, resume) as folder:
        stopwatch = Stopwatch(folder.journal.clock)
        yield Session(folder, seed, progress or Silent(), stopwatch, began_s, sumo_workers=sumo_workers)
