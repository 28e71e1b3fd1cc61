"""Surrogate against SUMO on one drawn road, at equal values, from little demand to more than fits."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from experiments.blind_effects.field_spec import DriverType, FieldSpec
from experiments.blind_effects.generate import DEPARTS_S, make_drive, write_case
from experiments.fidelity.transfer import SPARE_CAPACITY
from experiments.roads.drawn_road import find_road
from experiments.roads.road import BELIEVED_DRIVER
from jaxcalib.calibration.confirmation.agreement import Agreement, compare_sections, section_speeds_mps
from jaxcalib.calibration.stages.evaluator import Evaluations, Evaluator
from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem

DEMAND_FACTORS = (0.7, 0.85, 1.0, 1.1)  # on all inflows of the scenario
SURROGATE_RUNS_PER_SUMO_RUN = 4
NUM_DRIVES = 3  # of the case, which is there to say what is measured where
BROKEN_DOWN = 0.6  # of the speed that is wanted: a section slower than this in a drive has broken down
FIELD_SEED = 4_000


@dataclass(frozen=True)
class Inserted:
    """One entrance in both simulators."""

    input: str  # its id
    sumo: float  # share of the scheduled vehicles that entered
    surrogate: float  # the same


@dataclass(frozen=True)
class Point:
    """One demand in both simulators."""

    factor: float  # on the scenario's inflows
    agreement: Agreement  # speed by section
    sumo_broken: tuple[float, ...]  # share of the drives in which each section has broken down
    surrogate_broken: tuple[float, ...]  # the same
    sumo_any: float  # share of the drives that meet a breakdown anywhere
    surrogate_any: float  # the same
    sumo_drives: float  # independent drives that SUMO's are worth
    inserted: tuple[Inserted, ...]  # by entrance

    def as_table(self) -> dict[str, Any]:
        """Return it for a file."""
        return asdict(self) | {"agreement": self.agreement.as_table()}


def write_road_case(name: str, folder: Path) -> Path:
    """Write the case of a drawn road whose field is the scenario itself."""
    if not (folder / "case.toml").is_file():
        road = find_road(name)
        spec = FieldSpec((DriverType(1.0, dict(BELIEVED_DRIVER)),), road.subject, dict(road.inputs_vehph))
        departs_s = [road.warmup_s + DEPARTS_S[2 * number] for number in range(NUM_DRIVES)]
        made = [make_drive(spec, name, FIELD_SEED + number, at_s) for number, at_s in enumerate(departs_s)]
        write_case(folder, name, road, made, departs_s, ["fit"] * NUM_DRIVES)
    return folder


def compare_on_road(name: str, folder: Path, num_runs: int, decision_interval_s: float) -> list[Point]:
    """Compare both simulators on a road; SUMO's runs are kept in the case's folder for another comparison.

    Args:
        name: of the road.
        folder: where its case lies, or is to lie.
        num_runs: drives in SUMO at each demand, about; the surrogate makes four times as many.
        decision_interval_s: time between two decisions of the surrogate about lanes.
    """
    problem = read_problem(write_road_case(name, folder))
    inputs, starts = problem.layout.num_inputs, problem.drive_starts("fit")
    values = np.stack([problem.template.base_values()] * len(DEMAND_FACTORS))
    values[:, :inputs] *= np.asarray(DEMAND_FACTORS)[:, None]
    values = round_values(values)
    engine = surrogate_engine(problem, SPARE_CAPACITY, 0.0, decision_interval_s=decision_interval_s)
    ours = Evaluator(engine, starts, 0)
    num_runs = ours.rounds_of(num_runs)
    theirs = _runs_in_sumo(problem, values, num_runs, folder / f"sumo_{num_runs}.npz")
    mine = _Runs.of(ours.evaluate(values, SURROGATE_RUNS_PER_SUMO_RUN * num_runs), 0.0)
    return [_point(problem, number, mine, theirs) for number in range(len(DEMAND_FACTORS))]


@dataclass(frozen=True)
class _Runs:
    """What is compared of one simulator's runs at all demands."""

    tally: Float[np.ndarray, "point run tally"]  # nan where a run failed
    inserted_share: Float[np.ndarray, "point entrance"]  # vehicles that entered over those scheduled
    worth: float  # independent drives that those at one demand are worth

    @classmethod
    def of(cls, runs: Evaluations, worth: float) -> "_Runs":
        """Take it from evaluated candidates."""
        shares = []
        for outcomes in runs.outcomes:
            good = [outcome for outcome in outcomes if outcome.status.is_ok]
            arrived, inserted = (
                np.sum([getattr(outcome, name) for outcome in good], axis=0) for name in ("num_arrived", "num_inserted")
            )
            shares.append(inserted / np.maximum(arrived, 1))
        return cls(runs.tally, np.stack(shares), worth)


def _runs_in_sumo(problem: CalibrationProblem, values: np.ndarray, num_runs: int, file: Path) -> _Runs:
    if not file.is_file():
        with sumo_engine(problem) as engine:
            sumo = Evaluator(engine, problem.drive_starts("fit"), 0, shares_runs=True)
            runs = _Runs.of(sumo.evaluate(values, num_runs), sumo.worth(num_runs))
        np.savez_compressed(file, **vars(runs))
    with np.load(file) as kept:
        return _Runs(kept["tally"], kept["inserted_share"], float(kept["worth"]))


def _point(problem: CalibrationProblem, number: int, mine: _Runs, theirs: _Runs) -> Point:
    tallies = [tally[np.isfinite(tally).all(axis=1)] for tally in (mine.tally[number], theirs.tally[number])]
    factor = DEMAND_FACTORS[number]
    agreement = compare_sections(problem, tallies[0].sum(axis=0), tallies[1], f"at {factor:g} of the demand")
    wanted_mps = float(BELIEVED_DRIVER["speedFactor"]) * _limit_mps(problem)
    broken = [section_speeds_mps(problem, tally) < BROKEN_DOWN * wanted_mps for tally in tallies]
    return Point(
        factor=factor,
        agreement=agreement,
        sumo_broken=tuple(map(float, broken[1].mean(axis=0))),
        surrogate_broken=tuple(map(float, broken[0].mean(axis=0))),
        sumo_any=float(broken[1].any(axis=1).mean()),
        surrogate_any=float(broken[0].any(axis=1).mean()),
        sumo_drives=theirs.worth,
        inserted=tuple(
            Inserted(name, float(theirs.inserted_share[number, at]), float(mine.inserted_share[number, at]))
            for at, name in enumerate(problem.layout.input_ids)
        ),
    )


def _limit_mps(problem: CalibrationProblem) -> float:
    road = find_road(problem.case.name)
    return road.limit_mps(road.ego_edges[0])
