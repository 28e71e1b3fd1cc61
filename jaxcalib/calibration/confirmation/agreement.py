"""Whether the surrogate drives as SUMO does at equal values, by section: what its place in a search rests on."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.statistics.jackknife import jackknife

SPEED_TOLERANCE = 0.10  # relative, of a section's mean speed in SUMO
CHANCE = 2.0  # standard errors of SUMO's mean that a difference may be larger
LEAST_SHARE = 0.9  # of the sections


@dataclass(frozen=True)
class SectionSpeed:
    """Mean speed of the vehicles that the subject vehicle sees in one section, in both simulators."""

    begin_m: float  # where the section begins
    end_m: float  # where it ends
    surrogate_mps: float  # in the surrogate; nan where it saw nobody
    sumo_mps: float  # in SUMO
    sumo_error_mps: float  # its standard error over runs (jackknife)

    @property
    def is_alike(self) -> bool:
        """Whether the surrogate is within the tolerance, or beyond it by what chance explains."""
        allowed_mps = SPEED_TOLERANCE * self.sumo_mps + CHANCE * self.sumo_error_mps
        return bool(abs(self.surrogate_mps - self.sumo_mps) <= allowed_mps)


@dataclass(frozen=True)
class Agreement:
    """Surrogate against SUMO at one point."""

    where: str  # which point
    sections: tuple[SectionSpeed, ...]  # those that SUMO's runs saw

    @property
    def share_alike(self) -> float:
        """Share of the sections in which the surrogate is within the tolerance."""
        return float(np.mean([section.is_alike for section in self.sections])) if self.sections else 1.0

    @property
    def holds(self) -> bool:
        """Whether that is enough to search in the surrogate."""
        return self.share_alike >= LEAST_SHARE

    def __str__(self) -> str:
        """Return it as one line."""
        num_alike = sum(section.is_alike for section in self.sections)
        line = (
            f"surrogate against SUMO {self.where}: speed within {100 * SPEED_TOLERANCE:.0f}% (and chance) in "
            f"{num_alike} of {len(self.sections)} sections"
        )
        apart = [section for section in self.sections if not section.is_alike]
        if not apart:
            return line
        worst = max(apart, key=lambda one: abs(np.nan_to_num(one.surrogate_mps) / one.sumo_mps - 1.0))
        return (
            f"{line}; from {worst.begin_m:.0f} to {worst.end_m:.0f} m {worst.surrogate_mps:.1f} instead of "
            f"{worst.sumo_mps:.1f} m/s"
        )

    def as_table(self) -> dict[str, Any]:
        """Return it for result.json."""
        sections = [asdict(section) | {"is_alike": section.is_alike} for section in self.sections]
        return {"where": self.where, "share_alike": self.share_alike, "holds": self.holds, "sections": sections}


def compare_sections(
    problem: CalibrationProblem,
    surrogate: Float[np.ndarray, " tally"],
    sumo: Float[np.ndarray, "run tally"],
    where: str,
) -> Agreement:
    """Compare mean speeds by section.

    Args:
        problem: for sections and tallies.
        surrogate: pooled tallies of the surrogate's runs.
        sumo: tallies of each of SUMO's runs on the same drives, of the same values.
        where: which point, for people.
    """
    sumo_mps, error_mps = jackknife(sumo, lambda tally: section_speeds_mps(problem, tally))
    rows = np.stack([section_speeds_mps(problem, surrogate), sumo_mps, np.nan_to_num(error_mps)], axis=1)
    border_m = np.asarray(problem.road.section_border_m, float)
    seen = np.flatnonzero(np.isfinite(sumo_mps))
    return Agreement(
        where,
        tuple(SectionSpeed(float(border_m[at]), float(border_m[at + 1]), *map(float, rows[at])) for at in seen),
    )


def section_speeds_mps(
    problem: CalibrationProblem, tally: Float[np.ndarray, "*runs tally"]
) -> Float[np.ndarray, "*runs section"]:
    """Return the mean speed of the vehicles seen in each section; nan where nobody was."""
    index, sections = problem.tally_index, range(problem.road.num_sections)
    frames = tally[..., [index[f"section_frames[{section}]"] for section in sections]]
    speed = tally[..., [index[f"section_speed[{section}]"] for section in sections]]
    with np.errstate(divide="ignore", invalid="ignore"):
        return speed / frames
