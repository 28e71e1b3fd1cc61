"""Whole commands as a user gives them, from an empty cache of programs on, with what their profile says."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

SWEEP = ("--design", "sobol:128", "--seeds", "16")  # 2,048 runs


def measure_calibrate(case: Path) -> dict[str, Any]:
    """Time `jaxcalib calibrate`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        wall_s = run_command("calibrate", str(case), "--out", str(out), cache=folder)
        return _told(wall_s, json.loads((out / "result.json").read_text(encoding="utf-8"))["profile"])


def measure_diagnose(case: Path) -> dict[str, Any]:
    """Time `jaxcalib diagnose`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        wall_s = run_command("diagnose", str(case), "--out", str(out), cache=folder)
        return _told(wall_s, json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))["profile"])


def measure_sweep(case: Path) -> dict[str, Any]:
    """Time `jaxcalib sweep` with 2,048 runs of the surrogate."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "sweep.parquet"
        wall_s = run_command("sweep", str(case), "--out", str(table), *SWEEP, cache=folder)
        return _told(wall_s, json.loads(table.with_suffix(".json").read_text(encoding="utf-8"))["profile"])


def run_command(command: str, *arguments: str, cache: str) -> float:
    """Return the wall time of a command.

    Args:
        command: its name.
        arguments: what follows.
        cache: folder of compiled programs; an empty one has all compiled anew.

    Raises:
        RuntimeError: it failed.
    """
    line: Sequence[str] = [sys.executable, "-m", "jaxcalib", command, *arguments, "--profile", "--quiet"]
    began = time.perf_counter()
    done = subprocess.run(line, capture_output=True, text=True, check=False, env=os.environ | {"JAXCALIB_CACHE": cache})
    if done.returncode:
        raise RuntimeError(f"{command}: {done.stderr.strip().splitlines()[-1]}")
    return time.perf_counter() - began


def _told(wall_s: float, profile: dict[str, Any]) -> dict[str, Any]:
    here, beside = profile["this_thread_s"], profile["other_threads_s"]
    return {
        "wall_s": round(wall_s, 1),
        "compiling_s": round(here["compiling"] + beside.get("compiling", 0.0), 1),
        "surrogate_s": round(here["surrogate"], 1),
        "waiting_for_sumo_s": round(here["waiting for SUMO"], 1),
        "process_cpu_s": round(profile["process_cpu_s"], 1),
        "sumo_cpu_s": round(profile["sumo_cpu_s"], 1),
        "used_share": profile["used_share"],
    }
