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


@pytest.fixture(scope="module")
def simulate(small_case: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], dict[str, Any]]:
    folder = tmp_path_factory.mktemp("devices")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
    environment |= {"JAXCALIB_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}

    def run(num_devices: int) -> dict[str, Any]:
        result = folder / "result.json"
        subprocess.run(
            [sys.executable, str(SCRIPT), str(num_devices), str(small_case), str(result)], env=environment, check=True
        )
        return json.loads(result.read_text())

    return run


@pytest.fixture(scope="module")
def on_one_device(simulate: Callable[[int], dict[str, Any]]) -> dict[str, Any]:
    return simulate(1)


def test_runs_succeed_and_differ(on_one_device: dict[str, Any]) -> None:
    assert on_one_device["runs_of_devices"] == [[0, 1]]
    assert all(status == "ok" for status, *_ in on_one_device["forwards"])
    assert len({observed for _, observed, *_ in on_one_device["forwards"]}) == len(on_one_device["forwards"])


def test_a_program_from_the_cache_gives_the_same_bits_and_need_not_be_compiled(
    simulate: Callable[[int], dict[str, Any]], on_one_device: dict[str, Any]
) -> None:
    again = simulate(1)
    assert again["forwards"] == on_one_device["forwards"] == again["backwards"]
    assert again["compile_s"] < 0.5 * on_one_device["compile_s"]  # a twentieth, where nobody else computes


@pytest.mark.parametrize("num_devices", [pytest.param(2, marks=pytest.mark.nightly(REASON)), 8])
def test_each_run_is_the_same_to_the_bit_on_any_number_of_devices_and_in_any_place(
    simulate: Callable[[int], dict[str, Any]], on_one_device: dict[str, Any], num_devices: int
) -> None:
    shared = simulate(num_devices)
    assert shared["devices"] == num_devices
    # every device has its own two runs
    assert shared["runs_of_devices"] == [[2 * one, 2 * one + 1] for one in range(num_devices)]
    assert shared["forwards"] == on_one_device["forwards"]
    assert shared["backwards"] == on_one_device["forwards"]
