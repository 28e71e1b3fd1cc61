"""The program with its surroundings altered: `python -m experiments.faults.altered ALTERATIONS COMMAND ...`.

ALTERATIONS is a file of JSON, see `Alterations`; the rest is what follows `jaxcalib`.
"""

import json
import locale
import os
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from experiments.faults.broken_jobs import spoilt_job
from experiments.results.terminal import write_json

MODULE = ("-m", "experiments.faults.altered")


@dataclass(frozen=True)
class Alterations:
    """What is altered; nothing unless told."""

    cores: int | None = None  # how many the program believes to have
    uses_locale: bool = False  # number formats are the environment's, as where a script has called setlocale
    job: str = ""  # what befalls SUMO's jobs, see `broken_jobs`
    every: int = 1  # jobs of which one is befallen
    first: int = 0  # number of the first of these
    notes: str = ""  # folder in which befallen jobs are noted
    longest_run_s: float | None = None  # after which a job is killed
    question: str = ""  # which of SUMO's questions is answered wrongly: "loading" or "first run"
    answer: str = ""  # how, see `broken_answers`

    def write(self, file: Path) -> Path:
        """Keep them for the program."""
        write_json(file, asdict(self))
        return file


def alter(alterations: Alterations) -> None:
    """Alter this process, and those that it starts."""
    if alterations.cores is not None:
        believed = set(range(alterations.cores))
        os.sched_getaffinity = lambda process: believed
    if alterations.uses_locale:
        locale.setlocale(locale.LC_ALL, "")
    from sim_adapters.sumo import first_run, loading, question, simulator, workers

    if alterations.job:
        where = Path(alterations.notes)
        workers.run_job = partial(spoilt_job, alterations.job, alterations.every, alterations.first, where)
    if alterations.longest_run_s is not None:
        simulator.LocalWorkers = _short_lived(workers.LocalWorkers, alterations.longest_run_s)
    if alterations.question:
        module: Any = {"loading": loading, "first run": first_run}[alterations.question]
        longest_s = alterations.longest_run_s

        def start(name: str, asked: dict[str, Any], usual_s: float, form: type) -> Any:
            asked = {"how": alterations.answer}
            return question.start_worker("experiments.faults.broken_answers", asked, longest_s or usual_s, form)

        module.start_worker = start


def _short_lived(workers: Any, longest_run_s: float) -> Any:
    """Return who makes runs, and kills those that take longer."""

    class ShortLived(workers):
        def __init__(self, num_processes: int | None, usual_s: float, scratch: Path | None) -> None:
            super().__init__(num_processes, longest_run_s, scratch)

    return ShortLived


def main() -> None:
    """Alter the program and run it."""
    file, *arguments = sys.argv[1:]
    alterations = Alterations(**json.loads(Path(file).read_text(encoding="utf-8")))
    sys.argv[1:] = arguments
    from jaxcalib.cli.app import main as run

    alter(alterations)
    run()


if __name__ == "__main__":
    main()
