"""Fills a bank: diagnoses cases, one per core, and keeps all that was run."""

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from experiments.blind_effects.run import ANSWER
from experiments.diagnosis_bank.kept_case import KeptCase
from jaxcalib.diagnosis.answer.answer import Diagnosis
from sim_adapters.atomic_file import write_atomically


def fill_bank(folders: Sequence[Path], bank: Path, first: int | None) -> Iterator[tuple[str, str]]:
    """Diagnose cases that the bank does not hold, and say of each how that went; twins have no runs of their own."""
    chosen = [folder for folder in folders if folder.parent.name != "twins"][:first]
    own = sorted(os.sched_getaffinity(0))
    context = multiprocessing.get_context("spawn")
    cores = context.Queue()
    for core in own:
        cores.put(core)
    with ProcessPoolExecutor(len(own), mp_context=context, initializer=_pin, initargs=(cores,)) as pool:
        yield from pool.map(_fill, chosen, [bank] * len(chosen))


def write_answer(file: Path, diagnosis: Diagnosis) -> None:
    """Write diagnosis.json into a folder that is made if need be."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, lambda stream: stream.write(diagnosis.to_json().encode()))


def _pin(cores: "multiprocessing.Queue[int]") -> None:
    os.sched_setaffinity(0, {cores.get()})


def _fill(folder: Path, bank: Path) -> tuple[str, str]:
    case = KeptCase(folder, bank / folder.name)
    if (case.kept / ANSWER).is_file():
        return folder.name, "kept"
    began_s = time.perf_counter()
    try:
        with case.session(may_run=True) as session:
            _, diagnosis = case.diagnosed(session)
    except Exception as error:  # one case that fails must not take the others with it
        return folder.name, f"failed: {error!r}"
    write_answer(case.kept / ANSWER, diagnosis)
    return folder.name, f"{time.perf_counter() - began_s:.0f} s"
