"""Times by kind of work: exclusive within a thread, apart between threads, only while somebody listens."""

import threading
import time

import pytest

from sim_adapters import activity
from sim_adapters.activity import Activity, doing, latest_ledger, listening, sumo_took, took


class Clock:
    """Moves when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        return self.now

    def process_time(self) -> float:
        return 0.5 * self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    one = Clock()
    monkeypatch.setattr(activity, "time", one)
    return one


def test_work_within_other_work_is_taken_off_it(clock: Clock):
    with listening() as ledger:
        clock.now += 1.0
        with doing(Activity.SURROGATE):
            clock.now += 2.0
            with doing(Activity.COMPILING):
                clock.now += 4.0
            clock.now += 8.0
        clock.now += 16.0
    assert ledger.here_s == {Activity.SURROGATE: 10.0, Activity.COMPILING: 4.0}
    assert not ledger.beside_s


def test_what_is_told_afterwards_is_taken_off_what_the_thread_was_at(clock: Clock):
    with listening() as ledger:
        with doing(Activity.SURROGATE):
            clock.now += 5.0
            took(Activity.COMPILING, 3.0)
        took(Activity.COMPILING, 1.5)  # while it was at nothing that counts
        with doing(Activity.COMPILING):
            clock.now += 2.0
            took(Activity.COMPILING, 2.0)  # told twice, counted once
    assert ledger.here_s == {Activity.SURROGATE: 2.0, Activity.COMPILING: 6.5}


def test_threads_do_not_meet():
    begun, go_on = threading.Event(), threading.Event()

    @doing(Activity.COMPILING)
    def compile_aside() -> None:
        begun.set()
        go_on.wait(10.0)

    with listening() as ledger:
        aside = threading.Thread(target=compile_aside)
        aside.start()
        begun.wait(10.0)
        with doing(Activity.WAITING):
            time.sleep(0.05)
        go_on.set()
        aside.join()
    assert set(ledger.here_s) == {Activity.WAITING}
    assert set(ledger.beside_s) == {Activity.COMPILING}
    assert ledger.beside_s[Activity.COMPILING] >= ledger.here_s[Activity.WAITING] >= 0.05


@doing(Activity.READING)
def fail(clock: Clock) -> None:
    clock.now += 2.0
    raise ValueError("wrong")


def test_nobody_listens_and_an_error_ends_a_block(clock: Clock):
    assert latest_ledger() is None
    with doing(Activity.READING):
        clock.now += 1.0
    sumo_took(3.0)
    with listening() as ledger:
        assert latest_ledger() is ledger
        with pytest.raises(ValueError, match="wrong"):
            fail(clock)
        clock.now += 4.0
        sumo_took(0.75)
        sumo_took(0.5)
    assert ledger.here_s == {Activity.READING: 2.0}
    assert ledger.sumo_cpu_s == 1.25
    assert latest_ledger() is None
