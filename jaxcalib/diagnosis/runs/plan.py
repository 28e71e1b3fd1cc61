"""How many runs each part of a diagnosis gets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisBudget:
    """Numbers of runs of the surrogate, and of drives in SUMO, several of which may share a run (`num_runs_for`)."""

    first_null_drives: int  # drives in SUMO with calibrated values until they are seen to be the ones to stay with
    null_drives: int  # drives with those values in all
    altered_drives: int  # of how many of them altered versions are counted
    default_drives: int  # drives in SUMO's scenario as it is
    first_slope_runs: int  # surrogate runs of each trial of a parameter, likewise
    slope_runs: int  # the same in all
    effect_runs: int  # surrogate runs of each trial of an effect
    local_runs: int  # the same for an effect at one place
    silent_runs: int  # the same for each try of values that no log shows
    look_drives: int  # drives in SUMO with each effect that it has means for
    check_drives: int  # drives in SUMO with each of the best effects
    refit_drives: int  # drives in SUMO of each iteration of a refit


def plan_diagnosis(scale: float) -> DiagnosisBudget:
    """Return the numbers of runs; they grow and shrink with the scale, and 1 is the default."""

    def scaled(number: int, least: int) -> int:
        return max(least, round(number * scale))

    return DiagnosisBudget(
        first_null_drives=scaled(24, 24),
        null_drives=scaled(48, 24),
        altered_drives=scaled(15, 12),
        default_drives=scaled(8, 6),
        first_slope_runs=scaled(12, 12),
        slope_runs=scaled(32, 12),
        effect_runs=scaled(32, 12),
        local_runs=scaled(24, 12),
        silent_runs=scaled(8, 8),
        look_drives=scaled(12, 8),
        check_drives=scaled(16, 12),
        refit_drives=scaled(16, 12),
    )
