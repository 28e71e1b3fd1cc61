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
from jaxcalib.calibration.confirmation.agreement import Agreement, compare_sections
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


def compare_on_road(name: str, folder: Path, num_runs: int) -> list[Point]:
    """Compare both simulators on a road.

    Args:
        name: of the road.
        folder: where its case lies, or is to lie.
        num_runs: drives in SUMO at each demand, about; the surrogate makes four times as many.
    """
    problem = read_problem(write_road_case(name, folder))
    inputs, departs_s = problem.layout.num_inputs, problem.departs_s("fit")
    values = np.stack([problem.template.base_values()] * len(DEMAND_FACTORS))
    values[:, :inputs] *= np.asarray(DEMAND_FACTORS)[:, None]
    values = round_values(values)
    ours = Evaluator(surrogate_engine(problem, SPARE_CAPACITY, 0.0), departs_s, 0)
    num_runs = ours.rounds_of(num_runs)
    with sumo_engine(problem) as engine:
        sumo = Evaluator(engine, departs_s, 0, shares_runs=True)
        theirs = sumo.evaluate(values, num_runs)
        worth = sumo.worth(num_runs)
    mine = ours.evaluate(values, SURROGATE_RUNS_PER_SUMO_RUN * num_runs)
    return [_point(problem, number, mine, theirs, worth) for number in range(len(DEMAND_FACTORS))]


def section_speeds_mps(
    problem: CalibrationProblem, tally: Float[np.ndarray, "run tally"]
) -> Float[np.ndarray, "run section"]:
    """Return the mean speed of the vehicles seen in each section in each run; nan where nobody was."""
    index, sections = problem.tally_index, range(problem.road.num_sections)
    frames = tally[:, [index[f"section_frames[{section}]"] for section in sections]]
    speed = tally[:, [index[f"section_speed[{section}]"] for section in sections]]
    with np.errstate(divide="ignore", invalid="ignore"):
        return speed / frames


def _point(problem: CalibrationProblem, number: int, mine: Evaluations, theirs: Evaluations, worth: float) -> Point:
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
        sumo_drives=worth,
        inserted=tuple(
            Inserted(name, _inserted(theirs, number, at), _inserted(mine, number, at))
            for at, name in enumerate(problem.layout.input_ids)
        ),
    )


def _limit_mps(problem: CalibrationProblem) -> float:
    road = find_road(problem.case.name)
    return road.limit_mps(road.ego_edges[0])


def _inserted(runs: Evaluations, number: int, entrance: int) -> float:
    outcomes = [outcome for outcome in runs.outcomes[number] if outcome.status.is_ok]
    arrived = sum(float(outcome.num_arrived[entrance]) for outcome in outcomes)
    return sum(float(outcome.num_inserted[entrance]) for outcome in outcomes) / arrived if arrived else float("nan")
