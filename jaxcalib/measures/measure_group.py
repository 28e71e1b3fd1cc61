"""What one subject of the measures brings: what it counts, and what is made of the counts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxcalib.measures.fold import Fold
from jaxcalib.measures.measure import Measure
from jaxcalib.measures.scene import MeasureSettings


@dataclass(frozen=True)
class MeasureGroup:
    """Measures of one subject, for any road and sensor.

    Attributes:
        measures: the measures; their tallies may be counted by any group.
        folds: what is counted besides; nothing for quotients of tallies that there are already.
    """

    measures: Callable[[MeasureSettings], Sequence[Measure]]
    folds: Callable[[MeasureSettings], Sequence[Fold]] = lambda settings: ()
