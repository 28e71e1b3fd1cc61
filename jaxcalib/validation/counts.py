"""Counted vehicles: the user's table, the same counts in SUMO, and the criteria that rest on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxcalib.errors import CaseError, quote
from jaxcalib.field.table_files import Kind, column_names, read_columns, row_place
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.validation.criterion import FHWA_2019, Criterion, not_testable
from jaxcalib.validation.fhwa_2019 import FEWEST_DAYS, criteria_2019
from jaxcalib.validation.volumes import Volume, volume_criteria
from sim_adapters.units import SECONDS_PER_HOUR

COLUMNS: dict[str, Kind] = {"edge": "text", "begin_s": "number", "end_s": "number", "vehicles": "number"}
DAY = "day"
FEWEST_INTERVALS = 2
MOST_SPEEDING = 1.3  # times the limit, of nearly everybody
MOST_PER_LANE_VEHPH = 3000.0  # headways of 1.2 s for the whole interval: no lane carries more


@dataclass(frozen=True)
class FieldCounts:
    """Vehicles counted at the ends of edges; callable as what counts the same in SUMO."""

    places: tuple[tuple[str, float, float], ...]  # edge, begin and end of each interval
    vehicles: Float[np.ndarray, "day place"]  # counts, [day, interval]; nan where a day lacks one

    @property
    def edges(self) -> tuple[str, ...]:
        """Edges at whose end is counted."""
        return tuple(dict.fromkeys(edge for edge, _, _ in self.places))

    def __call__(self, passed_s: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the counts of a run from the times at which vehicles passed each edge's end."""
        return np.asarray(
            [np.sum((passed_s[edge] > begin) & (passed_s[edge] <= end)) for edge, begin, end in self.places], float
        )

    @property
    def hourly(self) -> Float[np.ndarray, " place"]:
        """Factor from counts to hourly rates."""
        return np.asarray([SECONDS_PER_HOUR / (end - begin) for _, begin, end in self.places])


def read_counts(file: Path, problem: CalibrationProblem) -> FieldCounts:
    """Return the counts of a table.

    Args:
        file: .csv, .csv.gz or .parquet with the columns edge, begin_s, end_s, vehicles and, if there are several days,
            day.
        problem: for the network and the scenario's clock.

    Raises:
        CaseError: the table is wrong, or counts where or when the scenario has nothing.
    """
    has_days = DAY in column_names(file)
    columns: dict[str, Kind] = {**COLUMNS, DAY: "text"} if has_days else COLUMNS
    table = read_columns(file, columns)
    if not table.num_rows:
        raise CaseError(file, "", "expected at least one row.")
    edges = [table.texts["edge"][1][index] for index in table.texts["edge"][0]]
    days = [table.texts[DAY][1][index] for index in table.texts[DAY][0]] if has_days else [""] * table.num_rows
    begin_s, end_s, vehicles = (table.numbers[name] for name in ("begin_s", "end_s", "vehicles"))
    known = {edge for edge, _ in problem.scenario.network.lanes}
    warmup_s, duration_s = problem.parts.scenario.warmup_s, problem.parts.scenario.duration_s
    cells: dict[tuple[str, float, float], dict[str, float]] = {}
    for row, (edge, day) in enumerate(zip(edges, days, strict=True)):
        if edge not in known:
            raise CaseError(
                file, row_place(row, "edge"), f"expected an edge of the route or a ramp, got {quote(edge)}."
            )
        if not 0.0 <= begin_s[row] < end_s[row] <= duration_s:
            raise CaseError(
                file, row_place(row, "begin_s"), f"expected 0 <= begin_s < end_s <= {duration_s:g}, the scenario's "
                f"end; got {begin_s[row]:g} and {end_s[row]:g}.",
            )  # fmt: skip
        if begin_s[row] < warmup_s:
            raise CaseError(
                file, row_place(row, "begin_s"), f"expected intervals after the warm-up ({warmup_s:g} s), in which the "
                f"road fills; got {begin_s[row]:g}. Leave the row out, or lower scenario.warmup_s.",
            )  # fmt: skip
        road = problem.scenario.network.net.getEdge(edge)
        step_m = MOST_SPEEDING * road.getSpeed() * problem.scenario.configuration.step_s
        if road.getLength() < step_m:
            raise CaseError(
                file, row_place(row, "edge"), f"expected an edge of {step_m:.0f} m or more, the way of a step, for "
                f"vehicles to be seen on it; {quote(edge)} has {road.getLength():.0f} m. Name a neighbour that carries "
                "the same vehicles.",
            )  # fmt: skip
        num_lanes = road.getLaneNumber()
        most = MOST_PER_LANE_VEHPH * num_lanes * (end_s[row] - begin_s[row]) / SECONDS_PER_HOUR
        if vehicles[row] > most:
            raise CaseError(
                file, row_place(row, "vehicles"), f"expected at most {most:.0f}, what {num_lanes} lanes carry in "
                f"{end_s[row] - begin_s[row]:g} s; got {vehicles[row]:g}. Are these vehicles per hour or of a day?",
            )  # fmt: skip
        if not vehicles[row] >= 0.0:
            raise CaseError(file, row_place(row, "vehicles"), f"expected 0 or more, got {vehicles[row]:g}.")
        of_place = cells.setdefault((edge, float(begin_s[row]), float(end_s[row])), {})
        if day in of_place:
            raise CaseError(file, row_place(row), f"expected edge {quote(edge)} and its interval once per day.")
        of_place[day] = float(vehicles[row])
    names = list(dict.fromkeys(days))
    places = tuple(sorted(cells))
    return FieldCounts(
        places, np.asarray([[cells[place].get(day, np.nan) for place in places] for day in names], float)
    )


def count_volumes(field: FieldCounts, simulated: Float[np.ndarray, "seed place"]) -> list[Volume]:
    """Return counted and simulated volumes as hourly rates, means over days and over seeds."""
    real, model = np.nanmean(field.vehicles, axis=0) * field.hourly, simulated.mean(axis=0) * field.hourly
    return [
        Volume(f"{edge}, {begin:g} to {end:g} s", float(counted), float(modelled), edge, end - begin)
        for (edge, begin, end), counted, modelled in zip(field.places, real, model, strict=True)
    ]


def count_criteria(field: FieldCounts, simulated: Float[np.ndarray, "seed place"]) -> list[Criterion]:
    """Return GEH, the criteria of 2004 and, where several days were counted, those of 2019."""
    shortest_s = min(end - begin for _, begin, end in field.places)
    source = "counts as hourly rates" + (
        f", intervals of {shortest_s:g} s: chance weighs more than in an hour" if shortest_s < SECONDS_PER_HOUR else ""
    )
    return [*volume_criteria(count_volumes(field, simulated), source), *_criteria_2019(field, simulated)]


def _criteria_2019(field: FieldCounts, simulated: Float[np.ndarray, "seed place"]) -> Sequence[Criterion]:
    """Return the criteria of 2019, for each edge that was counted in the same intervals on enough days."""
    run = simulated[int(np.argmin(np.abs(simulated - simulated.mean(axis=0)).sum(axis=1)))]  # the seed nearest the mean
    criteria: list[Criterion] = []
    left_out: list[str] = []
    for edge in field.edges:
        chosen = [number for number, (name, _, _) in enumerate(field.places) if name == edge]
        # what is counted on single days only, as an hour more of one of them, says nothing of the others
        chosen = [number for number in chosen if np.isfinite(field.vehicles[:, number]).sum() >= FEWEST_DAYS]
        days = field.vehicles[:, chosen]
        days = days[np.isfinite(days).all(axis=1)]
        if len(days) >= FEWEST_DAYS and len(chosen) >= FEWEST_INTERVALS:
            hourly = field.hourly[chosen]
            criteria += criteria_2019(days * hourly, run[chosen] * hourly, f"volume at {edge}")
        else:
            left_out.append(edge)
    title = "criteria I-IV of bounded dynamic error"
    reason = f"needs counts of at least {FEWEST_DAYS} days in the same {FEWEST_INTERVALS} or more intervals"
    if not criteria:
        return [not_testable(title, FHWA_2019, reason)]
    return [*criteria, *(not_testable(f"{title}, volume at {edge}", FHWA_2019, reason) for edge in left_out)]
