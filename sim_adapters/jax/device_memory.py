"""Whether a batch fits into the memory of the devices, told before anything is allocated."""

import os
from typing import Any

import jax

from sim_adapters.errors import TooLargeBatchError


def device_memory_bytes(device: Any) -> int | None:
    """Return the memory of a device, for a core its share of the machine's; None where nobody tells."""
    if device.platform != "cpu":
        told = device.memory_stats() or {}
        return told.get("bytes_limit")
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // jax.local_device_count()
    except (AttributeError, OSError, ValueError):
        return None


def check_memory(needed_bytes: int, num_runs: int, device: Any) -> None:
    """Check that a device's part of a batch fits.

    Args:
        needed_bytes: what it takes.
        num_runs: its runs.
        device: the device.

    Raises:
        TooLargeBatchError: it does not.
    """
    there_bytes = device_memory_bytes(device)
    if there_bytes is None or needed_bytes <= there_bytes:
        return
    num_fit = int(num_runs * there_bytes / needed_bytes)
    raise TooLargeBatchError(
        f"Expected at most {num_fit} runs of a batch on each device: {num_runs} need {needed_bytes / 1e9:.3g} GB, "
        f"and a {device.device_kind} has {there_bytes / 1e9:.3g} GB."
    )
