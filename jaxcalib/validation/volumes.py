"""Volumes against counts: GEH and the criteria of 2004."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.validation.criterion import FHWA_2004, Criterion, at_least, at_most

GEH_LIMIT, GEH_SUM_LIMIT, SHARE = 5.0, 4.0, 0.85
GEH_STANDARD = "DfT TAG M3.1; FHWA Toolbox III, 2004"


@dataclass(frozen=True)
class Volume:
    """A volume at one place in one interval."""

    place: str  # where and when
    field_vehph: float  # what was counted, as an hourly rate
    simulated_vehph: float  # mean over seeds, as an hourly rate
    edge: str = ""  # where alone
    duration_s: float = 1.0  # how long was counted

    @property
    def geh(self) -> float:
        """The GEH statistic of hourly rates."""
        return float(geh(np.asarray(self.simulated_vehph), np.asarray(self.field_vehph)))

    @property
    def is_within_2004(self) -> bool:
        """Whether it meets the bounds of 2004 for single volumes."""
        return abs(self.simulated_vehph - self.field_vehph) <= bound_2004_vehph(self.field_vehph)


def geh(simulated_vehph: Float[np.ndarray, "..."], field_vehph: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the GEH statistic; both in veh/h, for it grows with the square root of the period."""
    total = np.asarray(simulated_vehph + field_vehph, float)
    difference = np.asarray(simulated_vehph - field_vehph, float)
    return np.sqrt(2.0 * difference**2 / np.where(total > 0.0, total, 1.0))


def bound_2004_vehph(field_vehph: float) -> float:
    """Return how far a simulated volume may be from the counted one: 100, 15 %, 400 veh/h."""
    if field_vehph < 700.0:
        return 100.0
    return 0.15 * field_vehph if field_vehph <= 2700.0 else 400.0


def sum_of_volumes(volumes: list[Volume]) -> tuple[float, float]:
    """Return simulated and counted vehicles per hour on all edges together.

    Several intervals of one edge are one hourly rate, not several: GEH grows with the square root of what is added up.
    """
    rates: dict[str, list[Volume]] = {}
    for volume in volumes:
        rates.setdefault(volume.edge or volume.place, []).append(volume)
    simulated = counted = 0.0
    for several in rates.values():
        weight = np.asarray([volume.duration_s for volume in several])
        simulated += float(np.average([volume.simulated_vehph for volume in several], weights=weight))
        counted += float(np.average([volume.field_vehph for volume in several], weights=weight))
    return simulated, counted


def volume_criteria(volumes: list[Volume], source: str) -> list[Criterion]:
    """Return GEH and the criteria of 2004 for at least one volume; notes say with what they were counted."""
    simulated, field = (
        np.asarray([getattr(volume, name) for volume in volumes]) for name in ("simulated_vehph", "field_vehph")
    )
    both, counted = sum_of_volumes(volumes)
    total = float(abs(both - counted) / counted) if counted > 0.0 else float("nan")
    geh_of_sum = float(geh(np.asarray(both), np.asarray(counted)))
    note = f"{source}: {len(volumes)} volumes"
    return [
        at_least(
            "share of volumes with GEH below 5", GEH_STANDARD,
            float(np.mean(geh(simulated, field) < GEH_LIMIT)), SHARE, note,
        ),
        at_least(
            "share of volumes within 100 veh/h, 15 % or 400 veh/h", FHWA_2004,
            float(np.mean([volume.is_within_2004 for volume in volumes])), SHARE, note,
        ),
        at_most("relative error of the sum of volumes", FHWA_2004, total, 0.05, note),
        at_most("GEH of the sum of volumes", FHWA_2004, geh_of_sum, GEH_SUM_LIMIT, note),
    ]  # fmt: skip
