"""A batch that does not fit into memory is refused before it is compiled, in a line that says how many would fit."""

import re

import jax
import pytest

from jaxcalib.cli.guarded import EXIT_RESOURCE, guarded
from sim_adapters.errors import TooLargeBatchError
from sim_adapters.interface import RunRequest
from sim_adapters.jax import device_memory
from sim_adapters.jax.device_memory import check_memory, device_memory_bytes
from sim_adapters.world.world_builder import WorldTemplate
from tests.sim_adapters.jax.frame_trace import corridor_engine


def test_a_machine_has_memory_and_a_small_batch_fits() -> None:
    device = jax.devices()[0]
    there = device_memory_bytes(device)
    assert there is not None
    assert there > 1e8
    check_memory(1000, 3, device)


def test_the_line_says_how_many_runs_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_memory, "device_memory_bytes", lambda device: 3_000_000_000)
    check_memory(3_000_000_000, 70, jax.devices()[0])
    with pytest.raises(TooLargeBatchError, match=r"at most 30 runs .*: 70 need 7 GB, and a cpu has 3 GB"):
        check_memory(7_000_000_000, 70, jax.devices()[0])


def test_a_simulator_refuses_such_a_batch_before_it_compiles(
    template: WorldTemplate, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    simulator = corridor_engine(template, runs_per_device=50)
    monkeypatch.setattr(device_memory, "device_memory_bytes", lambda device: 8_000_000)
    request = RunRequest(tuple(template.base_values()), 1, 41.0)

    def work() -> str:
        return str(simulator.run([request]))

    assert guarded(work, go_on="") == EXIT_RESOURCE
    line = capsys.readouterr().err
    fits = re.search(r"at most (\d+) runs of a batch on each device: 50 need", line)
    assert fits is not None
    assert 0 < int(fits[1]) < 50
    assert simulator.compile_s == 0.0
