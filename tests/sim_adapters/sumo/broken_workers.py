"""Runs that go wrong; worker processes import them from here."""

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sim_adapters.sumo.job import LOG_FILE, SumoJob, SumoRun
from sim_adapters.sumo.worker import standard_error_in


def tries_of(job: SumoJob) -> Path:
    """Return the file that counts how often a seed was tried; it outlives the folder of a run."""
    return job.folder.parent.parent / f"tries-{job.seed}"


def note(job: SumoJob) -> int:
    with tries_of(job).open("a") as file:
        file.write("x")
    return tries_of(job).stat().st_size


def short_run(job: SumoJob) -> SumoRun:
    """Return a drive of two frames with one vehicle ahead; its speed is the seed."""
    four, num_entered = np.ones(4), np.asarray([5, 2])
    return SumoRun(
        time_s=np.asarray([1.0, 1.0, 1.5, 1.5]),
        vehicle=np.asarray([-1, 0, -1, 0]),
        row=np.zeros(4, int),
        position_m=np.asarray([100.0, 130.0, 105.0, 136.0]),
        speed_mps=job.seed * four,
        acceleration_mps2=0 * four,
        lateral_m=0 * four,
        num_arrived=num_entered + 1,
        num_inserted=num_entered,
        num_collisions=0,
        num_subject_overlaps=0,
        num_teleports=0,
        num_vehicle_steps=4,
        subject_left=(True,) * len(job.subject_vehicles),
        wall_s=0.0,
        cpu_s=0.25,
        passed_s={},
    )


def die(job: SumoJob) -> SumoRun:
    """Take the process along, as a crash of SUMO does."""
    note(job)
    os._exit(7)


def spoil_first(job: SumoJob, **spoilt: Any) -> SumoRun:
    """Answer wrongly at the first try."""
    run = short_run(job)
    return replace(run, **spoilt) if note(job) == 1 else run


def shorten_first(job: SumoJob) -> SumoRun:
    return spoil_first(job, position_m=np.asarray([100.0, 130.0, 105.0]))


def leave_road_first(job: SumoJob) -> SumoRun:
    return spoil_first(job, row=np.asarray([0, 0, 0, 1000]))


def go_back_in_time_first(job: SumoJob) -> SumoRun:
    return spoil_first(job, time_s=np.asarray([1.5, 1.5, 1.0, 1.0]))


def answer_the_unsendable(job: SumoJob) -> Any:
    note(job)
    return lambda: job


def answer_nothing(job: SumoJob) -> Any:
    """Answer with what is no run, each time."""
    note(job)


def die_once(job: SumoJob) -> SumoRun:
    """Take the process along at the first try."""
    if note(job) == 1:
        os._exit(7)
    return short_run(job)


def die_if_odd(job: SumoJob) -> SumoRun:
    """Take the process along for every other seed."""
    return die(job) if job.seed % 2 else short_run(job)


def hang(job: SumoJob) -> SumoRun:
    """Come to no end."""
    note(job)
    time.sleep(60.0)
    return short_run(job)


def complain(job: SumoJob) -> SumoRun:
    """Leave words in SUMO's log and fail."""
    (job.folder / LOG_FILE).write_text("Error: the last words.\n")
    raise RuntimeError("no such lane")


def die_with_last_words(job: SumoJob) -> SumoRun:
    """Take the process along as SUMO's C++ does, which says why on standard error."""
    with standard_error_in(job.folder / LOG_FILE):
        os.write(2, b"terminate called without an active exception\n")
        os._exit(7)


def see_nothing(job: SumoJob) -> SumoRun:
    """Return a run into which the subject vehicle never came."""
    none = np.empty(0)
    run = vars(short_run(job))
    rows = ("time_s", "vehicle", "row", "position_m", "speed_mps", "acceleration_mps2", "lateral_m")
    return SumoRun(**(run | dict.fromkeys(rows, none)))
