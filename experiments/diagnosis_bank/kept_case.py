"""A case of the bank: its search and all tallies are kept beside each other, so that the rest is made anew at will.

A diagnosis in RUN goes on only with the program that began it. Here the calibrated values and the tallies of runs,
which take minutes, outlive changes of the inference, which takes seconds. Whoever changes simulator, features or
calibration has to fill a new bank.
"""

import pickle  # reads what cloudpickle wrote
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import cloudpickle  # values hold closures
import numpy as np

from jaxcalib.diagnosis.answer.answer import Diagnosis
from jaxcalib.diagnosis.answer.conclusion import conclude
from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.features.features import DriveTallies, gather_tallies
from jaxcalib.diagnosis.features.noise import on_cells
from jaxcalib.diagnosis.run import answer
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import fine_interval_s
from jaxcalib.diagnosis.stages.calibrated import Calibrated, calibrate_by_logs
from jaxcalib.diagnosis.stages.session import DiagnosisSession, begin_session
from jaxcalib.diagnosis.stages.simulated import simulate_null
from jaxcalib.problem.problem import read_problem
from jaxcalib.runs.session import open_session
from sim_adapters.atomic_file import write_atomically
from surrogate.road.drive_table import drive_table

IDENTITY = {"case": "bank", "options": "bank", "program": "bank"}
CALIBRATED = "calibrated.pickle"


class NotKeptError(LookupError):
    """A judgement asks for runs that the bank does not hold."""


@dataclass(frozen=True)
class KeptCase:
    """A case and where the bank keeps what was run for it."""

    case: Path  # folder of the case
    kept: Path  # folder of its runs

    @contextmanager
    def session(self, may_run: bool) -> Iterator[DiagnosisSession]:
        """Open what is kept; without leave to run, runs that are missing raise NotKeptError."""
        began_s = time.perf_counter()
        problem = read_problem(self.case, as_stated=True)
        with open_session(self.kept, IDENTITY, resume=True, began_s=began_s) as work:
            session = begin_session(problem, 1.0, work)
            yield session if may_run else replace(session, parts=ReadOnlyParts(session.folder.path / "stages"))

    def calibrated(self, session: DiagnosisSession) -> Calibrated:
        """Return the values that the logs show, read only if they are not kept yet."""
        file = self.kept / CALIBRATED
        if file.is_file():
            return pickle.loads(file.read_bytes())  # noqa: S301 - our own
        calibrated = calibrate_by_logs(session)
        write_atomically(file, lambda stream: stream.write(cloudpickle.dumps(calibrated)))
        return calibrated

    def diagnosed(self, session: DiagnosisSession) -> tuple[Findings | None, Diagnosis]:
        """Return what a diagnosis finds and says; no findings where the drives show too little."""
        return answer(session, self.calibrated(session))

    def on_twin(self, twin: Path, session: DiagnosisSession, findings: Findings) -> Diagnosis:
        """Return what the same fit says of the drives that only a twin has.

        One half of them is held out, the other stands for the drives to fit, whose noise is in the answer that is
        judged by this.
        """
        problem = read_problem(twin, as_stated=True)
        interval_s = fine_interval_s(problem)
        drives = list(zip(problem.case.drives, problem.drives, strict=True))[len(session.problem.drives) :]
        more = [(stated.depart_s, drive) for stated, drive in drives]
        simulated = simulate_null(session, self.calibrated(session))
        baseline, maker = simulated.baseline, simulated.maker
        if not np.array_equal(baseline.values, findings.values):  # silent values were moved
            baseline = maker.whole(maker.at(findings.values, baseline.runner))
        tables = [drive_table(drive.frames(interval_s), interval_s) for _, drive in more]
        books = [baseline.features.of_table(table) for table in tables]
        tallies = gather_tallies(books, [depart_s for depart_s, _ in more])
        half = np.arange(len(more)) < len(more) // 2  # departures repeat every few drives
        stands_for_fit = replace(findings.fitted, tallies=on_cells(tallies.take(~half), findings.fitted.null.cells))
        return conclude(replace(findings, held_out=baseline.prepared(tallies.take(half)), fitted=stands_for_fit))


class ReadOnlyParts(FinishedParts):
    """Finished parts that are read and never made."""

    def tallies(self, name: str, make: Callable[[], Mapping[str, DriveTallies]]) -> dict[str, DriveTallies]:
        """Return the tallies of a part.

        Raises:
            NotKeptError: it is not there.
        """
        del make

        def refuse() -> Mapping[str, DriveTallies]:
            raise NotKeptError(name[:80])

        return super().tallies(name, refuse)
