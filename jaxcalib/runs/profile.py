"""Where a command's time goes: by kind of work, and how much of the cores' time is used."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import jax.monitoring

from sim_adapters.activity import Activity, Ledger, latest_ledger, listening, took

OTHER = "other"
COMPILATION = "/jax/core/compile/backend_compile_duration"  # tracing is told for each function within another again


@contextmanager
def profiled(is_wanted: bool) -> Iterator[None]:
    """Keep account of what a command does, if that is wanted; see `profile`."""
    if not is_wanted:
        yield
        return
    _listen_to_compilation()
    with listening():
        yield


def profile() -> dict[str, Any] | None:
    """Return where the time has gone by now; None where nobody asked for it.

    `this_thread_s` and `other_threads_s` are wall times by kind of work; a thread does one thing at a time. SUMO's
    processes are counted by processor time. `used_share` is the processor time of all over that of the cores.
    """
    ledger = latest_ledger()
    return None if ledger is None else _profile_of(ledger, len(os.sched_getaffinity(0)))


def _profile_of(ledger: Ledger, num_cores: int) -> dict[str, Any]:
    wall_s, cpu_s = time.perf_counter() - ledger.began_s, time.process_time() - ledger.began_cpu_s
    here = {str(kind): ledger.here_s.get(kind, 0.0) for kind in Activity}
    here[OTHER] = wall_s - sum(here.values())
    beside = {str(kind): seconds for kind in Activity if (seconds := ledger.beside_s.get(kind, 0.0))}
    return {
        "wall_s": _rounded(wall_s),
        "cores": num_cores,
        "this_thread_s": {kind: _rounded(seconds) for kind, seconds in here.items()},
        "other_threads_s": {kind: _rounded(seconds) for kind, seconds in beside.items()},
        "process_cpu_s": _rounded(cpu_s),
        "sumo_cpu_s": _rounded(ledger.sumo_cpu_s),
        "used_share": round((cpu_s + ledger.sumo_cpu_s) / (wall_s * num_cores), 3),
    }


def _rounded(seconds: float) -> float:
    return round(seconds, 2)


@cache
def _listen_to_compilation() -> None:
    def on_duration(event: str, duration_secs: float, **_: Any) -> None:
        if event == COMPILATION:  # told in the thread that compiles, at the end
            took(Activity.COMPILING, duration_secs)

    jax.monitoring.register_event_duration_secs_listener(on_duration)
