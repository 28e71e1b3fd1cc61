"""What the program says of a scenario before any long work: how well each part of it can be followed."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

WITHOUT = "the surrogate does without; SUMO runs with it"


class Level(Enum):
    """How a part of a scenario is followed by the surrogate; SUMO itself always runs it as it stands."""

    FOLLOWED = "followed"
    BESIDE = "taken along"  # moves nobody on the route
    APPROXIMATED = "approximated"
    SUMO_ALONE = "left to SUMO alone"


@dataclass(frozen=True)
class Finding:
    """One part of a scenario."""

    level: Level  # how well it is followed
    file: str  # name of the file in which it stands
    element: str  # which element or option
    words: str = ""  # by what it is approximated and what that may cost, or what to do
    count: int = 1  # how many such elements there are

    def __str__(self) -> str:
        """Return it as one line."""
        times = f" ({self.count} of them)" if self.count > 1 else ""
        return f"{self.file}: {self.element}{times}: {self.level.value}" + (f"; {self.words}" if self.words else "")


def sorted_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Findings in the order in which people should read them: what the surrogate cannot follow first."""
    order = (Level.SUMO_ALONE, Level.APPROXIMATED, Level.BESIDE, Level.FOLLOWED)
    return sorted(findings, key=lambda finding: order.index(finding.level))
