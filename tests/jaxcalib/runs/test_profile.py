"""Where a command's time went."""

import io

import jax
import jax.numpy as jnp
import pytest
from rich.console import Console

from jaxcalib.cli.profile_table import print_profile
from jaxcalib.runs import profile as told
from jaxcalib.runs.profile import profile, profiled
from sim_adapters.activity import Activity, Ledger, doing, sumo_took


def test_nobody_is_told_who_did_not_ask():
    with profiled(False):
        assert profile() is None
    console = Console(file=io.StringIO())
    print_profile(console)
    assert console.file.getvalue() == ""  # pyright: ignore[reportAttributeAccessIssue]


def test_parts_add_up_to_the_wall_time_and_cores_to_the_share_used(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(told.time, "perf_counter", lambda: 150.0)
    monkeypatch.setattr(told.time, "process_time", lambda: 33.0)
    ledger = Ledger(began_s=110.0, began_cpu_s=3.0, sumo_cpu_s=26.0)
    ledger.here_s |= {Activity.SURROGATE: 12.0, Activity.WAITING: 20.0}
    ledger.beside_s |= {Activity.COMPILING: 7.0}
    found = told._profile_of(ledger, 2)
    assert found["wall_s"] == 40.0
    assert sum(found["this_thread_s"].values()) == pytest.approx(40.0)
    assert found["this_thread_s"]["other"] == 8.0
    assert found["other_threads_s"] == {"compiling": 7.0}
    assert found["used_share"] == pytest.approx((30.0 + 26.0) / 80.0)


def test_programs_that_jax_compiles_are_counted_and_the_table_says_so():
    with profiled(True):
        with doing(Activity.SURROGATE):
            jax.jit(lambda value: jnp.sin(value) * 1.234567)(jnp.arange(7.0)).block_until_ready()
        sumo_took(1.5)
        found = profile()
        console = Console(file=io.StringIO(), width=100)
        print_profile(console)
    assert found is not None
    assert found["this_thread_s"]["compiling"] > 0.0
    assert found["this_thread_s"]["surrogate"] >= 0.0
    assert found["sumo_cpu_s"] == 1.5
    text = console.file.getvalue()  # pyright: ignore[reportAttributeAccessIssue]
    for words in ("compiling", "waiting for SUMO", "other", "SUMO's processes", "used: "):
        assert words in text
