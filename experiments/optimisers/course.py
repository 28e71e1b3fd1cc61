"""One optimiser on one problem with one seed: evaluated within a budget, journaled, and measured at checkpoints."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from jaxcalib.errors import CaseError
from jaxcalib.runs.parts import Parts
from jaxcalib.search.optimiser import Optimiser, Setting, Told

ROWS = "rows.json"
CHECKPOINT_SHARES = (0.125, 0.25, 0.5, 1.0)  # of the budget


class Problem(Protocol):
    """Something to optimise. The lower an error, the better; the one that optimisers are compared by is "error"."""

    @property
    def name(self) -> str:
        """Name, without the seed."""
        ...

    @property
    def seed(self) -> int:
        """Seed of all its random numbers."""
        ...

    @property
    def num_parameters(self) -> int:
        """Dimensions."""
        ...

    @property
    def start(self) -> Float[np.ndarray, " parameter"]:
        """Where every optimiser begins."""
        ...

    @property
    def has_slopes(self) -> bool:
        """Whether evaluations come with exact slopes."""
        ...

    def evaluate(self, points: Float[np.ndarray, "candidate parameter"], first: int) -> Told:
        """Return what becomes of candidates, the first of which has a number in the run."""
        ...

    def measure(self, points: Float[np.ndarray, "candidate parameter"]) -> dict[str, Any]:
        """Return errors of points as a user would meet them: without noise, or on fresh seeds and held-out drives."""
        ...


@dataclass(frozen=True)
class Budget:
    """What a search may use."""

    num_evaluations: int  # most candidates
    # most time of optimiser and evaluations together; the round that runs out of it still counts
    wall_s: float = float("inf")
    batch_size: int = 8  # see `Setting`
    num_planned: int | None = None  # candidates that optimisers plan their course for, where that is not the most


def run_course(
    name: str,
    make: Callable[[], Optimiser],
    problem: Problem,
    budget: Budget,
    journal: Path,
    clock: Callable[[], float] = time.perf_counter,
) -> list[dict[str, Any]]:
    """Return one row for each checkpoint; goes on with what the journal holds.

    The start is evaluated first, as candidate 0 of every optimiser. The best accuracy seen decides what is measured:
    it may be lucky, and `measure` says how good it is.

    Args:
        name: of the optimiser.
        make: returns it.
        problem: what to optimise.
        budget: what it may use.
        journal: folder of the rounds made so far and of the measured rows; written while it goes.
        clock: tells the time in seconds.

    Raises:
        CaseError: the journal belongs to another course.
    """
    parts = Parts.begin(journal)
    finished = parts.read(ROWS, _load)
    if finished is not None:
        return finished
    setting = Setting(
        problem.num_parameters,
        budget.num_planned or budget.num_evaluations,
        budget.batch_size,
        problem.start,
        problem.has_slopes,
        problem.seed,
    )
    began = clock()
    optimiser = make()
    state = optimiser.init(setting)
    optimiser_s, evaluation_s, num_evaluated = clock() - began, 0.0, 0
    best_point, best_accuracy = problem.start, -np.inf
    num_failed = num_rounds = 0
    history: list[tuple[int, float, float, np.ndarray, float]] = []
    points = problem.start[None]
    while len(points) and num_evaluated < budget.num_evaluations and optimiser_s + evaluation_s < budget.wall_s:
        points = points[: budget.num_evaluations - num_evaluated]
        name_of_round = f"round-{num_rounds:06d}.json"
        known = parts.read(name_of_round, _load)
        if known is not None:
            told, times = _told_again(known, points, journal)
            optimiser_s, round_s = times
        else:
            began = clock()
            told = problem.evaluate(points, num_evaluated)
            round_s = clock() - began
            _keep_round(parts, name_of_round, told, (optimiser_s, round_s))
        num_rounds += 1
        evaluation_s += round_s
        for point, accuracy in zip(told.points, told.accuracy, strict=True):
            num_evaluated += 1
            num_failed += not np.isfinite(accuracy)
            if accuracy > best_accuracy:
                best_point, best_accuracy = point, float(accuracy)
            history.append((num_evaluated, optimiser_s, evaluation_s, best_point, best_accuracy))
        began = clock()
        if len(history) > 1 and num_evaluated < budget.num_evaluations:
            state, _ = optimiser.tell(state, told)  # a round that was cut short is not told: it is the last
        points = optimiser.ask(state)
        optimiser_s += clock() - began
    rows = _measured_rows(name, problem, budget, history, num_failed)
    text = json.dumps(rows, indent=1)
    parts.write(ROWS, lambda stream: stream.write(text.encode()))
    return rows


def _measured_rows(
    name: str,
    problem: Problem,
    budget: Budget,
    history: list[tuple[int, float, float, np.ndarray, float]],
    num_failed: int,
) -> list[dict[str, Any]]:
    """Return a row for each checkpoint; the results of several are measured once where they are the same."""
    is_timed = np.isfinite(budget.wall_s)
    spent = [used[1] + used[2] if is_timed else used[0] for used in history]
    limit = budget.wall_s if is_timed else budget.num_evaluations
    places = [max(0, int(np.searchsorted(spent, share * limit, side="right")) - 1) for share in CHECKPOINT_SHARES]
    distinct, where = np.unique([history[place][3] for place in places], axis=0, return_inverse=True)
    errors = problem.measure(distinct)
    rows = []
    for number, (share, place) in enumerate(zip(CHECKPOINT_SHARES, places, strict=True)):
        num_evaluated, optimiser_s, evaluation_s, _, accuracy = history[place]
        rows.append(
            {
                "problem": problem.name,
                "optimiser": name,
                "seed": problem.seed,
                "budget": "wall_time" if is_timed else "simulations",
                "share": share,
                "limit": limit,
                "num_evaluated": num_evaluated,
                "num_failed_in_all": num_failed,
                "optimiser_s": optimiser_s,
                "evaluation_s": evaluation_s,
                "accuracy_seen": accuracy if np.isfinite(accuracy) else None,
                **{key: _number(values[where[number]]) for key, values in errors.items()},
            }
        )
    return rows


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _keep_round(parts: Parts, name: str, told: Told, times: tuple[float, float]) -> None:
    arrays = {"points": told.points, "accuracy": told.accuracy, "residuals": told.residuals, "slopes": told.slopes}
    text = json.dumps(
        {key: None if array is None else array.tolist() for key, array in arrays.items()} | {"times": times}
    )
    parts.write(name, lambda stream: stream.write(text.encode()))


def _load(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


def _told_again(
    known: dict[str, Any], points: Float[np.ndarray, "candidate parameter"], journal: Path
) -> tuple[Told, tuple[float, float]]:
    evaluated = np.asarray(known["points"], float)
    if not np.array_equal(evaluated, points):
        raise CaseError(
            journal, "", "expected the candidates that the optimiser asks; another version wrote them: begin anew."
        )
    slopes = None if known["slopes"] is None else np.asarray(known["slopes"], float)
    told = Told(evaluated, np.asarray(known["accuracy"], float), np.asarray(known["residuals"], float), slopes)
    return told, (float(known["times"][0]), float(known["times"][1]))
