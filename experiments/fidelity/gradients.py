"""`python -m experiments.fidelity.gradients`: is the derivative of a whole closed-loop drive the slope of its measures?

Forward mode differentiates the drive that is driven: positions and speeds answer to a parameter, but who changes lane,
who merges first and who is counted stay as they are. The slope that a search needs has both parts. It is estimated
here by central differences on common random numbers, measure by measure and parameter by parameter.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from jaxtyping import Array, Float

from experiments.benchmarks.throughput import CASE
from jaxcalib.calibration.objective.moments import Moments, all_moments
from jaxcalib.problem.engines import DECISION_INTERVAL_S, OBJECTS_PER_ROW, expected_vehicles
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from surrogate.loop.run_state import RunPlan
from surrogate.loop.simulate import observe_batch
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor
from surrogate.xla.materialise import compiler_options

RUNS_PER_BATCH = 16
DEPART_S, DRIVE_S = 151.0, 250.0  # the road is filled as far as the subject vehicle by then
NOISE_FACTOR = 3.0  # a slope counts if it exceeds its standard error so many times
LARGEST_RATIO = 1.5  # a derivative is usable within this factor of the slope, either way
PARAMETERS = ("tau", "accel", "speedFactor")  # and the first input
app = App(name="experiments.fidelity.gradients", help="Derivatives of closed-loop drives against differences.")


@dataclass(frozen=True)
class Agreement:
    """One measure and one parameter; slopes are relative: per cent of the measure per per cent of the parameter."""

    measure: str  # its name
    parameter: str  # its name
    slope: float  # by central differences of all drives together
    slope_error: float  # its standard error, jackknife over drives
    pathwise: float  # derivative by forward mode of the same drives
    cosine: float  # of both, drive by drive; nan where one is 0 throughout
    sign_agrees: float  # share of the drives with a slope in which both have one sign

    @property
    def counts(self) -> bool:
        """Whether the slope exceeds its noise."""
        return abs(self.slope) > NOISE_FACTOR * self.slope_error

    @property
    def is_usable(self) -> bool:
        """Whether the derivative has the slope's sign and about its size."""
        return 1.0 / LARGEST_RATIO <= self.pathwise / self.slope <= LARGEST_RATIO if self.slope else False


class Drives:
    """Batches of drives whose tallies can be differentiated by the parameter vector."""

    def __init__(self, problem: CalibrationProblem) -> None:
        """Compile one program: tallies and their derivative in one direction."""
        template, step_s = problem.template, problem.parts.scenario.step_s
        clock = Clock(step_s, round(DECISION_INTERVAL_S / step_s))
        capacity = expected_vehicles(problem) + template.road.num_rows
        plan = RunPlan(clock, capacity, round(problem.frame_interval_s / step_s))
        perception, axes = problem.case.perception, template.batch_axes(False)
        sensor = Sensor(jnp.asarray(perception.ahead_m), jnp.asarray(perception.behind_m), OBJECTS_PER_ROW)

        def tallies(values: Float[Array, " parameter"], seeds: Array) -> tuple[Array, Array]:
            departs_s = jnp.full(seeds.shape, DEPART_S, jnp.float32)
            spread = jnp.broadcast_to(values, (*seeds.shape, *values.shape))
            worlds = jax.vmap(template.world, out_axes=axes)(spread, seeds, departs_s)
            first_s = jnp.asarray(DEPART_S - clock.interval_s, jnp.float32)
            end_s = jnp.asarray(DEPART_S + DRIVE_S, jnp.float32)
            record = observe_batch(worlds, axes, sensor, problem.tally, plan, first_s, end_s)
            return record.observed, record.is_finite & (record.num_lost == 0) & record.subject_entered

        def with_derivative(values: Array, direction: Array, seeds: Array) -> tuple[Array, Array, Array]:
            observed, slope, is_good = jax.jvp(
                lambda values: tallies(values, seeds), (values,), (direction,), has_aux=True
            )
            return observed, slope, is_good

        base = jnp.asarray(template.base_values(), jnp.float32)
        seeds = jnp.arange(RUNS_PER_BATCH, dtype=jnp.int32)
        self._program = jax.jit(with_derivative).lower(base, base, seeds).compile(compiler_options())

    def __call__(self, values: np.ndarray, direction: np.ndarray, batch: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the tallies of each drive of a batch, and their derivative in a direction.

        Raises:
            RuntimeError: a run failed.
        """
        seeds = jnp.arange(RUNS_PER_BATCH, dtype=jnp.int32) + batch * RUNS_PER_BATCH
        parts = self._program(jnp.asarray(values, jnp.float32), jnp.asarray(direction, jnp.float32), seeds)
        observed, slope, is_good = (np.asarray(part) for part in parts)
        if not is_good.all():
            raise RuntimeError("Expected drives that succeed.")
        return observed.astype(float), slope.astype(float)


def agreements(problem: CalibrationProblem, num_batches: int, difference: float) -> list[Agreement]:
    """Return how derivatives and differences compare, for all measures that are quotients of tallies.

    Differences are taken over a step relative to the parameter's value.
    """
    drives, moments = Drives(problem), all_moments(problem.measures, problem.tally_index)
    base, names = problem.template.base_values(), problem.layout.names
    compared = []
    for parameter in (names[0], *PARAMETERS):
        direction = np.where(np.asarray(names) == parameter, base, 0.0)
        middle, path, ahead, behind = [], [], [], []
        for batch in range(num_batches):
            tally, slope = drives(base, direction, batch)
            middle.append(tally)
            path.append(slope)
            ahead.append(drives(base + difference * direction, direction, batch)[0])
            behind.append(drives(base - difference * direction, direction, batch)[0])
        compared += compare_slopes(
            moments, parameter, difference, *(np.concatenate(each) for each in (middle, path, ahead, behind))
        )
    return compared


def compare_slopes(
    moments: Moments,
    parameter: str,
    difference: float,
    middle: np.ndarray,
    path: np.ndarray,
    ahead: np.ndarray,
    behind: np.ndarray,
) -> list[Agreement]:
    """Return one record per measure; all arrays are [drive, tally]."""
    value = moments.values(middle.mean(axis=0))

    def secant(rows: np.ndarray) -> np.ndarray:
        both = moments.values(ahead[rows].mean(axis=0)) - moments.values(behind[rows].mean(axis=0))
        return both / (2.0 * difference) / np.abs(value)

    def pathwise(rows: np.ndarray) -> np.ndarray:
        tally, slope = middle[rows].mean(axis=0), path[rows].mean(axis=0)
        above, below = moments.scale * slope[moments.numerator], slope[moments.denominator]
        with np.errstate(divide="ignore", invalid="ignore"):
            derivative = (above - moments.values(tally) * below) / tally[moments.denominator]
        return derivative / np.abs(value)

    every = np.arange(len(middle))
    with np.errstate(divide="ignore", invalid="ignore"):
        whole_secant, whole_path = secant(every), pathwise(every)
        left_out = np.asarray([secant(np.delete(every, drive)) for drive in every])
        secants = np.asarray([secant(np.asarray([drive])) for drive in every])
        paths = np.asarray([pathwise(np.asarray([drive])) for drive in every])
    error = np.sqrt((len(every) - 1) * left_out.var(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        secants, paths = np.nan_to_num(secants), np.nan_to_num(paths)  # drives in which nothing was observed
        cosine = (secants * paths).sum(axis=0) / np.linalg.norm(secants, axis=0) / np.linalg.norm(paths, axis=0)
    return [
        Agreement(
            measure=name,
            parameter=parameter,
            slope=float(whole_secant[number]),
            slope_error=float(error[number]),
            pathwise=float(whole_path[number]),
            cosine=float(cosine[number]),
            sign_agrees=_share_of_one_sign(secants[:, number], paths[:, number]),
        )
        for number, name in enumerate(moments.names)
        if np.isfinite(whole_secant[number])
    ]


def _cell(agreement: Agreement | None) -> str:
    if agreement is None or not agreement.counts:
        return ""
    return f"{agreement.slope:+.2f} / {agreement.pathwise:+.3g}{' *' if agreement.is_usable else ''}"


def _share_of_one_sign(secants: np.ndarray, paths: np.ndarray) -> float:
    moves = secants != 0.0
    return float(np.mean(np.sign(secants[moves]) == np.sign(paths[moves]))) if moves.any() else float("nan")


@app.default
def gradients(
    case: Path = CASE,
    /,
    *,
    batches: Annotated[int, Parameter(validator=Number(gte=1, lte=100))] = 8,
    difference: Annotated[float, Parameter(validator=Number(gt=0.0, lte=0.2))] = 0.05,
    out: Path | None = None,
) -> int:
    """Print a table: measure by measure, for each parameter the slope and the derivative.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    batches
        Batches of 16 seeds.
    difference
        Step of the differences, relative to the parameter's value.
    out
        File for all records, one line of JSON each.
    """
    compared = agreements(read_problem(case), batches, difference)
    if out is not None:
        lines = [json.dumps({**asdict(row), "counts": row.counts, "is_usable": row.is_usable}) for row in compared]
        out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"Slope / pathwise derivative, in % per %; only slopes above {NOISE_FACTOR:g} standard errors; * usable.\n")
    parameters = tuple(dict.fromkeys(agreement.parameter for agreement in compared))
    print(f"| measure | {' | '.join(parameters)} |\n|---|{'---|' * len(parameters)}")
    of = {(agreement.measure, agreement.parameter): agreement for agreement in compared}
    for measure in dict.fromkeys(agreement.measure for agreement in compared):
        cells = [_cell(of.get((measure, parameter))) for parameter in parameters]
        if any(cells):
            print(f"| {measure} | {' | '.join(cells)} |")
    for parameter in parameters:
        those = [agreement for agreement in compared if agreement.parameter == parameter and agreement.counts]
        usable = sum(agreement.is_usable for agreement in those)
        same = sum(agreement.pathwise * agreement.slope > 0.0 for agreement in those)
        print(
            f"{parameter}: of {len(those)} slopes {same} have the derivative's sign, and {usable} are met "
            f"within a factor of {LARGEST_RATIO:g}."
        )
    return 0


if __name__ == "__main__":
    app()
