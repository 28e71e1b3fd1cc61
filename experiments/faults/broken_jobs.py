"""Jobs of SUMO's workers that end badly; worker processes import them from here."""

import json
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from sim_adapters.sumo.job import SumoJob, SumoRun
from sim_adapters.sumo.worker import run_job

TALLY = "tally"


def spoilt_job(how: str, every: int, first: int, notes: Path, job: SumoJob) -> Any:
    """Make a run, or do what befalls it instead.

    Args:
        how: name in `BREAKING` or `GARBAGE`.
        every: one of so many jobs is befallen; tries again count as jobs.
        first: number of the first of these.
        notes: folder in which it is noted, for whoever looks on.
        job: the job.
    """
    with FileLock(notes / ".lock"):
        tally = notes / TALLY
        number = len(tally.read_bytes()) if tally.exists() else 0
        tally.write_bytes(b"x" * (number + 1))
    if number % every != first:
        return run_job(job)
    note = {"process": os.getpid(), "began_s": time.time(), "seed": job.seed, "how": how}
    draft = notes / f".befallen-{number}.json"
    draft.write_text(json.dumps(note), encoding="utf-8")
    draft.rename(notes / f"befallen-{number}.json")
    return BREAKING[how](job) if how in BREAKING else GARBAGE[how](run_job(job))


def segfault(job: SumoJob) -> Any:
    """End as a crash of SUMO's C++ does."""
    os.kill(os.getpid(), signal.SIGSEGV)


def leave(job: SumoJob) -> Any:
    """End the process as if all were well."""
    os._exit(0)


def hang(job: SumoJob) -> Any:
    """Come to no end."""
    while True:
        time.sleep(1.0)


def raise_error(job: SumoJob) -> Any:
    """Run out of memory."""
    raise MemoryError


def unsendable(job: SumoJob) -> Any:
    """Answer what cannot be sent to another process."""
    return lambda: job


BREAKING: Mapping[str, Callable[[SumoJob], Any]] = {
    "segfault": segfault, "leave": leave, "hang": hang, "raise": raise_error, "unsendable": unsendable,
}  # fmt: skip
GARBAGE: Mapping[str, Callable[[SumoRun], Any]] = {
    "nothing": lambda run: None,
    "text": lambda run: "garbage",
    "no numbers": lambda run: replace(run, speed_mps=np.full_like(run.speed_mps, np.nan)),
    "short arrays": lambda run: replace(run, position_m=run.position_m[:-1]),
    "unknown rows": lambda run: replace(run, row=run.row + 1000),
    "no arrays": lambda run: replace(run, time_s=None, vehicle="x"),  # pyright: ignore[reportArgumentType]
}
