"""Measures of effectiveness: the errors of Eqs. 24-36 and their sum of Eq. 23."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.measures.measure import Level, Measure, Moe

CUT_IN_LOWER_BOUND = 0.0  # Delta_LB of Eq. 32
CUT_IN_UPPER_SHARE = 0.5  # Delta_UB as a share of the field's cut-ins, at least 1
MOES = tuple(moe.value for moe in Moe)
VEHICLE_LEVEL = tuple(moe.value for moe in Moe if moe.level is Level.VEHICLE)
TRAFFIC_LEVEL = tuple(moe.value for moe in Moe if moe.level is Level.TRAFFIC)
VEHICLE_LEVEL_SUM = "vehicle_level"  # of the first, Eq. 23


@dataclass(frozen=True)
class Effectiveness:
    """Errors of a simulation against the field."""

    errors: Mapping[str, float | None]  # relative errors as fractions, by name; None where there is none
    notes: Mapping[str, str]  # why there is none, by name

    @property
    def vehicle_level(self) -> float:
        """Sum over the vehicle-level errors that there are (Eq. 23)."""
        return float(sum(self.errors[name] or 0.0 for name in VEHICLE_LEVEL))


def vehicle_level_of(draws: Sequence[Effectiveness], seen: Effectiveness) -> list[float]:
    """Return Eq. 23 of simulated sets over the terms that the field has; a set that lacks one of them is left out.

    Args:
        draws: errors of sets of simulated drives.
        seen: errors against the field.
    """
    terms = [name for name in VEHICLE_LEVEL if seen.errors[name] is not None]
    sums = []
    for draw in draws:
        errors = [error for name in terms if (error := draw.errors[name]) is not None]
        if len(errors) == len(terms):
            sums.append(float(sum(errors)))
    return sums


def effectiveness(
    measures: Mapping[str, Measure],
    tally_names: tuple[str, ...],
    field: Float[np.ndarray, " tally"],
    simulated: Float[np.ndarray, " tally"],
) -> Effectiveness:
    """Return the errors of pooled simulated tallies against pooled tallies of the field.

    Args:
        measures: all measures, by name.
        tally_names: names of the tallies.
        field: tallies of the field's drives, added up.
        simulated: tallies of the runs, added up.

    Source: Eqs. 23-36.
    Deviation: a quantity that the field never shows is left out; one that only the simulation never shows is an error
        of 1, as the paper's relative errors are undefined in both cases. Cut-ins count per drive, averaged over runs,
        and the upper bound of Eq. 32 is half of the field's count but at least 1, since with the printed bound of 1
        the error of a whole number is 0 or 1 and nothing between. Lane-changing distances are restricted means over
        changes, censored ones included, since what the sensors see in full are the short ones, at times one change in
        five. The background's are not averaged for each vehicle first (Eq. 29).
    """
    real, model = (dict(zip(tally_names, values, strict=True)) for values in (field, simulated))
    errors: dict[str, float | None] = {}
    notes: dict[str, str] = {}
    by_moe = {measure.moe: measure for measure in measures.values()}
    for moe in Moe:
        name, measure = moe.value, by_moe[moe]
        in_field, in_model = measure.value(real), measure.value(model)
        if not in_field.is_valid:
            errors[name], notes[name] = None, f"the field: {in_field.reason}"
        elif not in_model.is_valid:
            errors[name], notes[name] = 1.0, f"the simulation: {in_model.reason}; counted as an error of 1"
        elif moe is Moe.CUT_INS:
            errors[name] = cut_in_error(in_field.value, in_model.value)
        elif in_field.value == 0.0:
            errors[name], notes[name] = None, "the field's value is 0"
        else:
            errors[name] = float(abs(in_model.value - in_field.value) / in_field.value)
    return Effectiveness(errors, notes)


def cut_in_error(field_per_drive: float, simulated_per_drive: float) -> float:
    """Return the fuzzy membership of Eq. 32."""
    upper = max(1.0, CUT_IN_UPPER_SHARE * field_per_drive)
    difference = abs(field_per_drive - simulated_per_drive)
    return float(np.clip((difference - CUT_IN_LOWER_BOUND) / (upper - CUT_IN_LOWER_BOUND), 0.0, 1.0))


def noise_floor(
    measures: Mapping[str, Measure],
    tally_names: tuple[str, ...],
    runs: Float[np.ndarray, "run tally"],
    drive: np.ndarray,
    num_draws: int = 200,
    seed: int = 0,
) -> list[Effectiveness]:
    """Return the errors of the simulation against field-like sets of its own runs.

    Args:
        measures: all measures, by name.
        tally_names: names of the tallies.
        runs: tallies of runs at one point, all on seeds of their own.
        drive: which drive each run stands for.
        num_draws: sets drawn: one run of each drive; the simulation is all other runs.
        seed: of the draws.
    """
    generator = np.random.default_rng(seed)
    runs_of_drives = [np.flatnonzero(drive == number) for number in np.unique(drive)]
    draws = []
    for _ in range(num_draws):
        chosen = np.asarray([generator.choice(candidates) for candidates in runs_of_drives])
        others = np.setdiff1d(np.arange(len(runs)), chosen)
        if len(others):
            draws.append(effectiveness(measures, tally_names, runs[chosen].sum(axis=0), runs[others].sum(axis=0)))
    return draws


def mean_errors(draws: list[Effectiveness]) -> dict[str, float | None]:
    """Return the mean of each error over draws; None where no draw had it."""
    means: dict[str, float | None] = {}
    for name in MOES:
        known = [draw.errors[name] for draw in draws if draw.errors[name] is not None]
        means[name] = float(np.mean(np.asarray(known, float))) if known else None
    return means
