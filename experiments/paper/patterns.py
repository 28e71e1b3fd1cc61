"""Traffic patterns: the case's own field, and fields simulated in SUMO from known parameters and stated demands."""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.paper.crash_free import first_crash_free_draw
from experiments.paper.drive_writer import write_drives
from jaxcalib.case.case import Drive
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError
from jaxcalib.problem.parameter_space import parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.atomic_file import write_atomically

OWN_FIELD = 1
TRUTH_SEED = 2015
# Of its range: how far a known driver parameter lies from the scenario's. Farther ones keep such time gaps that a
# road cannot carry its demand.
NEAREST, FARTHEST = 0.2, 0.35
FIELD_SEED = 2_100_000_000  # of the first drive of the first simulated pattern; calibrations use seeds below it
SEEDS_PER_PATTERN = 10_000
PATTERN_FILE, DRIVERS_FILE = "pattern.json", "drivers.json"
HELD_OUT_FACTOR = 6  # of the case's own, in a simulated field


@dataclass(frozen=True)
class Demand:
    """How the demand of a pattern differs from the scenario's."""

    name: str  # what a person would call it
    total: float  # factor on all inflows
    ramps: float  # further factor on all inputs but the first


# As far from the scenario as a default one is from a road: what a calibration could not gain it would not show.
DEMANDS = (
    Demand("own field", 1.0, 1.0),
    Demand("light", 0.7, 1.0),
    Demand("heavy", 1.2, 1.0),
    Demand("busy ramps", 0.8, 1.5),
    Demand("quiet ramps", 1.1, 0.5),
)


def true_values(problem: CalibrationProblem, demand: Demand, draw: int = 0) -> np.ndarray:
    """Return the parameter values of a simulated pattern: the same drivers in all of them.

    The drivers are drawn once, each parameter 20 to 35 % of its range away from the scenario's, up or down where the
    range allows both; the seed is fixed, so that every user's are the same. `draw` is that of `drawn_drivers`.
    """
    base = round_values(problem.template.base_values())
    num_inputs = problem.layout.num_inputs
    space = parameter_space(problem.layout, problem.model, base[:num_inputs], 0.5, {})
    unit, random = space.unit_of(base), np.random.default_rng((TRUTH_SEED, draw))
    away = random.choice((-1.0, 1.0), len(base)) * random.uniform(NEAREST, FARTHEST, len(base))
    is_outside = np.abs(unit + away - 0.5) > 0.5
    values = space.values_of(np.clip(unit + np.where(is_outside, -away, away), 0.0, 1.0))
    factor = demand.total * np.where(np.arange(num_inputs) > 0, demand.ramps, 1.0)
    values[:num_inputs] = base[:num_inputs] * factor
    return round_values(values)


def drawn_drivers(problem: CalibrationProblem, folder: Path) -> int:
    """Return the number of the first draw whose drivers do not crash in any simulated pattern; a file keeps it."""
    file = folder / DRIVERS_FILE
    if not file.is_file():
        simulated = sorted(DEMANDS[OWN_FIELD:], key=lambda demand: -demand.total)  # most crashes come with most traffic
        draw = first_crash_free_draw(
            problem, lambda number: (true_values(problem, demand, number) for demand in simulated)
        )
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(file, lambda stream: stream.write(f'{{"draw": {draw}}}\n'.encode()))
    return int(json.loads(file.read_text(encoding="utf-8"))["draw"])


def prepare_pattern(problem: CalibrationProblem, number: int, folder: Path) -> Path:
    """Return the folder of a pattern's case; it is made if it is not there yet.

    Pattern 1 is the case's own field, 2 and up are the further entries of `DEMANDS`.

    Raises:
        CaseError: there is no such pattern.
    """
    if not 1 <= number <= len(DEMANDS):
        raise CaseError("command line", "--patterns", f"expected 1 to {len(DEMANDS)}, got {number}.")
    if number == OWN_FIELD:
        return problem.case.folder
    to = folder / f"pattern-{number}"
    if (to / PATTERN_FILE).is_file():
        return to
    shutil.rmtree(to, ignore_errors=True)  # begun, and stopped before its end
    shutil.copytree(problem.case.folder, to)
    values = true_values(problem, DEMANDS[number - 1], drawn_drivers(problem, folder))
    problem = _with_more_held_out(problem, to / FILE_NAME)
    write_drives(problem, values.tolist(), FIELD_SEED + SEEDS_PER_PATTERN * number, to)
    about = {
        "pattern": number,
        "demand": DEMANDS[number - 1].__dict__,
        "parameters": dict(zip(problem.layout.names, values.tolist(), strict=True)),
        "first_seed": FIELD_SEED + SEEDS_PER_PATTERN * number,
        "held_out_drives": len(problem.case.drives_of("held_out")),
    }
    write_atomically(to / PATTERN_FILE, lambda file: file.write((json.dumps(about, indent=1) + "\n").encode()))
    return to


def _with_more_held_out(problem: CalibrationProblem, case_file: Path) -> CalibrationProblem:
    """Return the problem with each held-out drive several times, and add them to a copy of its case file.

    The few that a case has leave more to chance than methods differ by; simulated ones cost seconds each.
    """
    more: list[Drive] = []
    for copy in range(2, HELD_OUT_FACTOR + 1):
        for drive in problem.case.drives_of("held_out"):
            name = f"{drive.id}-{copy}"
            files = [
                file.with_name(f"{name}_{what}{''.join(file.suffixes)}")
                for file, what in ((drive.subject_file, "subject"), (drive.objects_file, "objects"))
            ]
            more.append(replace(drive, id=name, subject_file=files[0], objects_file=files[1]))
    tables = [
        f"\n[[drive]]\nid       = {json.dumps(drive.id)}\ndepart_s = {drive.depart_s!r}\n"
        f"subject  = {json.dumps(drive.subject_file.relative_to(problem.case.folder).as_posix())}\n"
        f"objects  = {json.dumps(drive.objects_file.relative_to(problem.case.folder).as_posix())}\n"
        f'role     = "held_out"\n'
        for drive in more
    ]
    case_file.write_text(case_file.read_text(encoding="utf-8") + "".join(tables), encoding="utf-8")
    return replace(problem, case=replace(problem.case, drives=(*problem.case.drives, *more)))
