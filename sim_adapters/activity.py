"""What a process spends its time on: told by those who do the work, added up where somebody listens.

Times of a thread are exclusive: who compiles in the midst of a batch takes that time off the batch.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum


class Activity(StrEnum):
    """A kind of work."""

    READING = "reading"
    COMPILING = "compiling"
    SURROGATE = "surrogate"
    WAITING = "waiting for SUMO"
    REPORT = "report"


@dataclass(eq=False)
class Ledger:
    """Times since somebody began to listen."""

    thread: int = field(default_factory=threading.get_ident)  # the one that listens
    began_s: float = field(default_factory=time.perf_counter)
    began_cpu_s: float = field(default_factory=time.process_time)
    here_s: dict[Activity, float] = field(default_factory=lambda: defaultdict(float))  # of that thread
    beside_s: dict[Activity, float] = field(default_factory=lambda: defaultdict(float))  # of others of this process
    sumo_cpu_s: float = 0.0  # processor time of SUMO's processes on this machine

    def enter(self, activity: Activity, seconds: float) -> None:
        """Add time that the present thread has spent."""
        of_thread = self.here_s if threading.get_ident() == self.thread else self.beside_s
        of_thread[activity] += seconds


@dataclass
class _Doing(threading.local):
    """What the present thread is at, the innermost last, and since when it is."""

    activities: list[Activity] = field(default_factory=list)
    since_s: float = 0.0


_ledgers: list[Ledger] = []
_lock = threading.Lock()
_doing = _Doing()


@contextmanager
def listening() -> Iterator[Ledger]:
    """Add up what this process does from now on."""
    ledger = Ledger()
    with _lock:
        _ledgers.append(ledger)
    try:
        yield ledger
    finally:
        with _lock:
            _ledgers.remove(ledger)


@contextmanager
def doing(activity: Activity) -> Iterator[None]:
    """Tell that a block does one kind of work; also a decorator."""
    _settle()
    _doing.activities.append(activity)
    try:
        yield
    finally:
        _settle()
        _doing.activities.pop()


def took(activity: Activity, seconds: float) -> None:
    """Tell what the present thread has just spent on a kind of work, whatever it was at."""
    _enter(activity, seconds)
    if _doing.activities:
        _enter(_doing.activities[-1], -seconds)


def sumo_took(cpu_s: float) -> None:
    """Tell the processor time of a run in a process of this machine."""
    with _lock:
        for ledger in _ledgers:
            ledger.sumo_cpu_s += cpu_s


def latest_ledger() -> Ledger | None:
    """Return the ledger of who began to listen last; None if nobody listens."""
    with _lock:
        return _ledgers[-1] if _ledgers else None


def _settle() -> None:
    """Enter what the present thread has done since it was last asked."""
    now = time.perf_counter()
    if _doing.activities:
        _enter(_doing.activities[-1], now - _doing.since_s)
    _doing.since_s = now


def _enter(activity: Activity, seconds: float) -> None:
    with _lock:
        for ledger in _ledgers:
            ledger.enter(activity, seconds)
