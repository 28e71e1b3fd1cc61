"""How far the gap shrinks, on drives that nothing was fitted to or chosen by.

The gap is the mean over features of the squared difference between drives and simulation in units of noise. A single
feature counts at most CAP, so that none of them is the whole answer. The floor is the gap of sets of null runs.
"""

from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features import DriveTallies
from jaxcalib.diagnosis.noise import NullModel, on_cells

CAP = 100.0
NUM_DRAWS = 400
NUM_FLOOR_SETS = 60
INTERVAL = (0.05, 0.95)


@dataclass(frozen=True)
class Shrinkage:
    """Gaps on held-out drives.

    Attributes:
        default: of the scenario as it is.
        recalibrated: of the calibrated simulation.
        with_effect: of that with the effect.
        ceiling: with all effects of the library at once, each as strong as the drives to fit ask for.
        floor: what chance alone makes of it.
        fraction_closed: share of the gap above the floor that the effect closes; None where there is no such gap.
        interval_90: its interval over drives; None where one drive was held out or there is no gap.
    """

    default: float
    recalibrated: float
    with_effect: float
    ceiling: float
    floor: float
    fraction_closed: float | None
    interval_90: tuple[float, float] | None


def noise_floor(simulated: DriveTallies, null: NullModel, num_drives: int, random: np.random.Generator) -> float:
    """Return the mean gap of sets of null runs, as many as there are drives.

    A set is part of the runs that its gap is measured from; what that takes off its variance is put back.
    """
    runs = on_cells(simulated, null.cells)
    size = min(num_drives, len(runs) // 2)
    found = []
    for _ in range(NUM_FLOOR_SETS):
        drawn = runs.take(random.permutation(len(runs))[:size])
        values = np.where(drawn.below.sum(axis=0) > 0, drawn.values(), null.mean)
        found.append(np.mean(np.minimum(null.standardised(values) ** 2, CAP)))
    one, all_runs = 1.0 / size, 1.0 / len(runs)
    return float(np.mean(found)) * (1.0 / num_drives + all_runs) / (one - all_runs)


def measure_shrinkage(
    held_out: DriveTallies,
    null: NullModel,
    simulated: DriveTallies,
    default_values: np.ndarray,
    baseline_steps: np.ndarray,
    effect_steps: np.ndarray,
    effect_shift: np.ndarray | None,
    flexible: tuple[np.ndarray, np.ndarray],
    random: np.random.Generator,
) -> Shrinkage:
    """Return the gaps.

    Args:
        held_out: tallies of the drives.
        null: the null model for as many drives.
        simulated: tallies of the null runs, for the floor.
        default_values: features of the scenario as it is.
        baseline_steps: shift of the parameters that the drives to fit ask for, without effect.
        effect_steps: the same with the effect.
        effect_shift: what the effect adds to the features, in units of noise; None where no effect was found.
        flexible: shift of the parameters and of the features with all effects at once.
        random: for the interval.
    """
    tallies = on_cells(held_out, null.cells)

    def gap(difference: np.ndarray) -> float:
        return float(np.mean(np.minimum(np.nan_to_num(difference, nan=0.0) ** 2, CAP)))

    def gaps(values: np.ndarray) -> tuple[float, float]:
        difference = null.standardised(values)
        before = gap(difference - null.slope @ baseline_steps)
        if effect_shift is None:
            return before, before
        return before, gap(difference - null.slope @ effect_steps - effect_shift)

    floor = noise_floor(simulated, null, len(tallies), random)
    values = tallies.values()
    recalibrated, with_effect = gaps(values)
    ceiling = gap(null.standardised(values) - null.slope @ flexible[0] - flexible[1])
    default = gap(null.standardised(values) - null.standardised(default_values))
    fraction, interval = None, None
    if effect_shift is not None and recalibrated > floor:
        fraction = (recalibrated - with_effect) / (recalibrated - floor)
        if len(tallies) > 1:
            draws = []
            for _ in range(NUM_DRAWS):
                drawn = tallies.take(random.integers(0, len(tallies), len(tallies)))
                one, other = gaps(np.where(drawn.below.sum(axis=0) > 0, drawn.values(), values))
                # drawing drives again adds their noise a second time
                excess = one - 2.0 * floor if one > 2.0 * floor else max(one - floor, 1e-6)
                draws.append((one - other) / excess)
            low, high = np.quantile(draws, INTERVAL)
            # more than all of a gap cannot be closed; what lies above is noise of the ratio
            interval = (float(min(low, fraction)), float(max(min(high, 1.0), fraction)))
    return Shrinkage(default, recalibrated, with_effect, ceiling, floor, fraction, interval)
