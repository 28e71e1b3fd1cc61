"""Remembers every run that was made, so that a stopped calibration goes on by replaying itself.

No state of a search is stored: the program runs again from its beginning and finds the runs that it has made already.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxcalib.runs.disk import checked_disk, writing_to_scratch
from jaxcalib.runs.parts import Parts
from sim_adapters.interface import NO_DRIVE, ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.sumo.simulator import SumoSimulator

COLUMNS = ("key", "status", "observed", "num_arrived", "num_inserted", "num_collisions", "num_teleports",
           "num_subject_overlaps", "num_vehicle_steps", "subject_left", "wall_s", "log_tail")  # fmt: skip


class Journal:
    """Outcomes of runs by what was asked, in memory and in part files."""

    def __init__(self, folder: Path | None) -> None:
        """Read what is there; without a folder nothing is kept."""
        self._parts = None if folder is None else Parts.begin(folder)
        self._outcomes: dict[str, RunOutcome] = {}
        self._next_part = 0
        self._share_s: dict[str, float] = {}  # time that runs of parts took, until they are asked for
        self._replayed_s = 0.0
        if self._parts is not None:
            for name in self._parts.names("part-*.npz"):
                columns = self._parts.read(name, _load_columns)
                self._next_part = int(name.removeprefix("part-").removesuffix(".npz")) + 1
                if columns is not None:
                    self._take(columns)

    @property
    def num_runs(self) -> int:
        """Runs that are known."""
        return len(self._outcomes)

    def find(self, engine: str, request: RunRequest) -> RunOutcome | None:
        """Return the outcome of a run, if it is known."""
        key = key_of(engine, request)
        self._replayed_s += self._share_s.pop(key, 0.0)
        outcome = self._outcomes.get(key)
        return None if outcome is None else replace(outcome, request=request)  # parts do not hold effects

    def clock(self) -> float:
        """Return a time in seconds that goes on by what replayed runs once took, so that resumed runs time alike."""
        return time.perf_counter() + self._replayed_s

    def add(self, engine: str, outcomes: Sequence[RunOutcome], elapsed_s: float) -> None:
        """Keep outcomes."""
        keys = [key_of(engine, outcome.request) for outcome in outcomes]
        self._outcomes |= dict(zip(keys, outcomes, strict=True))
        # a simulator that died says nothing of the candidate: whoever resumes tries it again
        kept = [(key, made) for key, made in zip(keys, outcomes, strict=True) if made.status is not Status.FAILED]
        if self._parts is not None and kept:
            part: dict[str, Any] = _part_of(*map(list, zip(*kept, strict=True)))
            part["elapsed_s"] = np.asarray(elapsed_s)
            self._parts.write(f"part-{self._next_part:06d}.npz", lambda file: np.savez(file, **part))
            self._next_part += 1

    def _take(self, columns: dict[str, np.ndarray]) -> None:
        for row, key in enumerate(columns["key"].tolist()):
            self._share_s[key] = float(columns["elapsed_s"]) / len(columns["key"])
            self._outcomes[key] = _outcome_of(columns, row)


class JournaledSurrogate:
    """The surrogate, which makes only runs that the journal does not know."""

    def __init__(self, simulator: JaxSimulator, journal: Journal) -> None:
        """Keep both."""
        self._simulator = simulator
        self._journal = journal

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        return self._simulator.layout

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order.

        A call is journaled as a whole, because the room that it needs is found out in it.
        """
        engine = self._engine
        known = [self._journal.find(engine, request) for request in requests]
        if all(outcome is not None for outcome in known):
            return [outcome for outcome in known if outcome is not None]
        began = time.perf_counter()
        before = self._simulator.compile_s
        outcomes = self._simulator.run(requests)
        elapsed_s = time.perf_counter() - began - (self._simulator.compile_s - before)
        if self._engine == engine:
            self._journal.add(engine, outcomes, elapsed_s)
        return outcomes

    @property
    def _engine(self) -> str:
        """What its runs depend on beside what is asked."""
        return f"surrogate-{self._simulator.capacity}-{self._simulator.decision_interval_s:g}"


class JournaledSumo:
    """SUMO, which makes only runs that the journal does not know."""

    def __init__(self, simulator: SumoSimulator, journal: Journal) -> None:
        """Keep both."""
        self._simulator = simulator
        self._journal = journal

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        return self._simulator.layout

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order."""
        return self.start(requests)()

    def start(
        self, requests: Sequence[RunRequest], on_run: Callable[[int], None] | None = None
    ) -> Callable[[], list[RunOutcome]]:
        """Start runs in the background, and return what waits for all of them; `on_run` is told of each."""
        known = [self._journal.find("sumo", request) for request in requests]
        missing = [request for request, outcome in zip(requests, known, strict=True) if outcome is None]
        with writing_to_scratch():
            waiting = self._simulator.submit(missing)

        def wait() -> list[RunOutcome]:
            outcomes = []
            began = time.perf_counter()
            for outcome in known:
                if outcome is None:
                    with writing_to_scratch():  # a run that failed is made again
                        (made,) = checked_disk([next(waiting)()])
                    now = time.perf_counter()
                    self._journal.add("sumo", [made], now - began)
                    began = now
                    outcome = made
                outcomes.append(outcome)
                if on_run is not None:
                    on_run(1)
            return outcomes

        return wait


def key_of(engine: str, request: RunRequest) -> str:
    """Return a name for a run in an engine; the same for the same run, whenever it is made."""
    text = f"{engine} {request.seed} {request.depart_s!r} " + " ".join(repr(float(value)) for value in request.values)
    text += "".join(f" {name} {setting!r}" for name, setting in sorted(request.effects.items()))
    text += f" also {sorted(request.also_depart_s)!r}" if request.also_depart_s else ""
    text += f" drive {request.drive}" if request.drive != NO_DRIVE else ""
    return hashlib.sha256(text.encode()).hexdigest()


def _load_columns(file: Path) -> dict[str, np.ndarray]:
    with np.load(file, allow_pickle=False) as part:
        return {name: part[name] for name in (*COLUMNS, "values", "seed", "depart_s", "drive", "elapsed_s")}


def _part_of(keys: list[str], outcomes: Sequence[RunOutcome]) -> dict[str, np.ndarray]:
    size = max((len(outcome.observed) for outcome in outcomes if outcome.observed is not None), default=0)
    nothing = np.full(size, np.nan)
    return {
        "key": np.asarray(keys),
        "status": np.asarray([outcome.status.name for outcome in outcomes]),
        "observed": np.asarray([nothing if o.observed is None else o.observed for o in outcomes], float),
        "num_arrived": np.asarray([outcome.num_arrived for outcome in outcomes]),
        "num_inserted": np.asarray([outcome.num_inserted for outcome in outcomes]),
        "num_collisions": np.asarray([outcome.num_collisions for outcome in outcomes]),
        "num_teleports": np.asarray([outcome.num_teleports for outcome in outcomes]),
        "num_subject_overlaps": np.asarray([outcome.num_subject_overlaps for outcome in outcomes]),
        "num_vehicle_steps": np.asarray([outcome.num_vehicle_steps for outcome in outcomes]),
        "subject_left": np.asarray([outcome.subject_left for outcome in outcomes], bool),
        "wall_s": np.asarray([outcome.wall_s for outcome in outcomes]),
        "log_tail": np.asarray([outcome.log_tail for outcome in outcomes]),
        "values": np.asarray([outcome.request.values for outcome in outcomes], float),
        "seed": np.asarray([outcome.request.seed for outcome in outcomes]),
        "depart_s": np.asarray([outcome.request.depart_s for outcome in outcomes], float),
        "drive": np.asarray([outcome.request.drive for outcome in outcomes], int),
    }


def _outcome_of(columns: dict[str, np.ndarray], row: int) -> RunOutcome:
    status = Status[str(columns["status"][row])]
    return RunOutcome(
        request=RunRequest(
            tuple(columns["values"][row].tolist()),
            int(columns["seed"][row]),
            float(columns["depart_s"][row]),
            drive=int(columns["drive"][row]),
        ),
        status=status,
        observed=columns["observed"][row] if status.is_ok else None,
        num_arrived=columns["num_arrived"][row],
        num_inserted=columns["num_inserted"][row],
        num_collisions=int(columns["num_collisions"][row]),
        num_teleports=int(columns["num_teleports"][row]),
        num_subject_overlaps=int(columns["num_subject_overlaps"][row]),
        num_vehicle_steps=int(columns["num_vehicle_steps"][row]),
        subject_left=bool(columns["subject_left"][row]),
        wall_s=float(columns["wall_s"][row]),
        log_tail=str(columns["log_tail"][row]),
    )
