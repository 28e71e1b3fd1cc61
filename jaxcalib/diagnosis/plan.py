"""How many runs each part of a diagnosis gets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisBudget:
    """Numbers of runs.

    Attributes:
        first_null_runs: SUMO runs with calibrated values until they are seen to be the ones to stay with.
        null_runs: SUMO runs with those values in all.
        altered_runs: of how many of them altered versions are counted.
        default_runs: SUMO runs of the scenario as it is.
        first_slope_runs: surrogate runs of each trial of a parameter, likewise.
        slope_runs: the same in all.
        effect_runs: surrogate runs of each trial of an effect.
        local_runs: the same for an effect at one place.
        check_runs: SUMO runs with each of the best effects.
        refit_runs: SUMO runs of each iteration of a refit.
    """

    first_null_runs: int
    null_runs: int
    altered_runs: int
    default_runs: int
    first_slope_runs: int
    slope_runs: int
    effect_runs: int
    local_runs: int
    check_runs: int
    refit_runs: int


def plan_diagnosis(scale: float) -> DiagnosisBudget:
    """Return the numbers of runs; they grow and shrink with the scale, and 1 is the default."""

    def scaled(number: int, least: int) -> int:
        return max(least, round(number * scale))

    return DiagnosisBudget(
        first_null_runs=scaled(24, 24),
        null_runs=scaled(48, 24),
        altered_runs=scaled(12, 6),
        default_runs=scaled(8, 6),
        first_slope_runs=scaled(12, 12),
        slope_runs=scaled(32, 12),
        effect_runs=scaled(32, 12),
        local_runs=scaled(24, 12),
        check_runs=scaled(16, 12),
        refit_runs=scaled(16, 12),
    )
