"""The same runs on 1, 2 and 8 devices, compiled and from the cache, each in a process of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.places import ROOT

pytestmark = pytest.mark.long

REASON = "another 20 s of compiling; on eight devices every commit sees that their number changes nothing"
SCRIPT = ROOT / "tests/sim_adapters/jax/simulate_case.py"
RUNS_PER_DEVICE = 16

Simulate = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def simulate(small_case: Path, tmp_path_factory: pytest.TempPathFactory, as_users_do: dict[str, str]) -> Simulate:
    """Return what simulates on so many devices: with a cache that is empty at first, or with that of all tests."""
    folder = tmp_path_factory.mktemp("devices")
    environment = {name: value for name, value in as_users_do.items() if not name.startswith("JAX_")}
    environment["PYTHONPATH"] = str(ROOT)

    def run(num_devices: int, cache: str = str(folder / "cache")) -> dict[str, Any]:
        result = folder / "result.json"
        command = [sys.executable, str(SCRIPT), str(num_devices), str(small_case), str(result)]
        subprocess.run(command, env=environment | {"JAXCALIB_CACHE": cache}, check=True)
        return json.loads(result.read_text())

    return run


@pytest.fixture(scope="module")
def on_one_device(simulate: Simulate) -> dict[str, Any]:
    """Runs with a program that is kept from one call of the tests to the next."""
    told = simulate(1, os.environ["JAXCALIB_CACHE"])
    assert told["batch"] == RUNS_PER_DEVICE
    return told


@pytest.fixture(scope="module")
def on_eight_devices(simulate: Simulate) -> dict[str, Any]:
    return simulate(8)


def test_runs_succeed_and_differ(on_one_device: dict[str, Any]) -> None:
    assert on_one_device["runs_of_devices"] == [list(range(RUNS_PER_DEVICE))]
    assert all(status == "ok" for status, *_ in on_one_device["forwards"])
    assert len({observed for _, observed, *_ in on_one_device["forwards"]}) == len(on_one_device["forwards"])
    assert on_one_device["backwards"] == on_one_device["forwards"]


def test_a_program_from_the_cache_gives_the_same_bits_and_need_not_be_compiled(
    simulate: Simulate, on_eight_devices: dict[str, Any]
) -> None:
    again = simulate(8)
    assert again["forwards"] == on_eight_devices["forwards"] == again["backwards"]
    assert again["compile_s"] < 0.5 * on_eight_devices["compile_s"]  # a twentieth, where nobody else computes


@pytest.mark.parametrize("num_devices", [pytest.param(2, marks=pytest.mark.nightly(REASON)), 8])
def test_each_run_is_the_same_to_the_bit_on_any_number_of_devices_and_in_any_place(
    simulate: Simulate, on_one_device: dict[str, Any], on_eight_devices: dict[str, Any], num_devices: int
) -> None:
    shared = on_eight_devices if num_devices == 8 else simulate(num_devices)
    assert shared["devices"] == num_devices
    # every device has its own runs
    places = range(num_devices * RUNS_PER_DEVICE)
    assert shared["runs_of_devices"] == [
        list(places[first : first + RUNS_PER_DEVICE]) for first in places[::RUNS_PER_DEVICE]
    ]
    assert shared["forwards"] == on_one_device["forwards"]
    assert shared["backwards"] == on_one_device["forwards"]
