"""Options that several commands share, with what they mean."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, Token
from cyclopts.validators import Number


def _whole(form: type, tokens: Sequence[Token]) -> int:
    """Return a whole number; what has a fraction is not rounded to one.

    Raises:
        ValueError: it is none.
    """
    (token,) = tokens
    try:
        return int(token.value)
    except ValueError:
        raise ValueError(f"expected a whole number, got {token.value}") from None


WholeNumber = Annotated[int, Parameter(converter=_whole)]
CaseFolder = Annotated[Path, Parameter(help="Folder with case.toml, the SUMO scenario and the logs.")]
CalibratedRun = Annotated[Path, Parameter(help="Folder that `jaxcalib calibrate` has left.")]
Seed = Annotated[
    WholeNumber,
    Parameter(
        validator=Number(gte=0, lte=2000), help="Seed of all random numbers; the same seed gives the same result."
    ),
]
Budget = Annotated[
    float,
    Parameter(
        validator=Number(gte=0.05, lte=100.0),
        help="Factor on the numbers of simulation runs: 0.5 is quick, 2 is thorough.",
    ),
]
Cluster = Annotated[
    str | None,
    Parameter(help="Address of a dask scheduler whose workers make SUMO's runs (docs/cluster.md)."),
]
Profile = Annotated[
    bool,
    Parameter(negative="", help="Say at the end where the time went, by kind of work, and keep it in the result."),
]
Quiet = Annotated[bool, Parameter(negative="", help="Say nothing but errors.")]
