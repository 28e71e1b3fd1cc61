"""Options of a calibration beyond the command line, from an optional TOML file."""

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.search.registry import OPTIMISERS

SETTINGS = "settings"  # what errors call them that come from no file
Part = Literal["logs", "optimiser", "polish", "gradients", "correction"]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Options of a calibration.

    Attributes:
        scaling_factor: delta of Eqs. 5 and 6: how far an inflow may leave its initial value.
        bounds: own bounds by name of input or vType attribute, [lower, upper].
        num_critical: K: how many driver parameters Stage 2's optimiser moves at most.
        optimiser: of Stage 2, by its name in `jaxcalib.search.registry`; `literal` takes the printed Algorithm 3.
        objective: "likelihood" weighs errors by their noise; "paper" takes the mean relative error of Eqs. 2 and 11.
        also_match: measures that the likelihood matches besides: those of safety, which it leaves out, say.
        accuracy_threshold: a_thre of Algorithms 1 and 3; the accuracy that the truth shows on average unless given.
        literal: Algorithms 1 and 3 as printed, with their slips.
        without: parts that are left out, to see what they buy: what the logs say of drivers, Stage 2's optimiser, the
            joint polish, the gradient refinement, the search corrected by SUMO.
    """

    scaling_factor: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.2
    bounds: dict[str, tuple[float, float]] = {}
    num_critical: Annotated[int, Meta(ge=1, le=50)] = 10
    optimiser: str = "trust_region"
    objective: Literal["likelihood", "paper"] = "likelihood"
    also_match: tuple[str, ...] = ()
    accuracy_threshold: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None
    literal: bool = False
    without: tuple[Part, ...] = ()

    def __post_init__(self) -> None:
        """Check what the types cannot."""
        if self.optimiser not in OPTIMISERS:
            raise ValueError(f"expected an optimiser of {', '.join(OPTIMISERS)}; got {quote(self.optimiser)}")

    @property
    def stage_2_optimiser(self) -> str:
        """Name of the optimiser that Stage 2 uses."""
        return "saga_literal" if self.literal else self.optimiser


def read_settings(file: Path | None) -> Settings:
    """Return the settings of a file, or the defaults.

    Raises:
        CaseError: the file is missing or wrong.
    """
    if file is None:
        return Settings()
    table: dict[str, Any] = {}
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        return msgspec.convert(table, Settings)
    except OSError as error:
        raise CaseError(file, "", f"expected a settings file: {shorten(error.strerror or str(error))}.") from None
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at ")
        place = place.strip("`").removeprefix("$").removeprefix(".")
        if place.startswith("bounds["):  # msgspec does not say which of them
            place = f"bounds.{_odd_bounds(table['bounds'])}"
        raise CaseError(file, place, f"{shorten(message, 150)}.") from None
    except (ValueError, RecursionError) as error:
        raise CaseError(file, "", f"expected TOML: {shorten(str(error), 150)}.") from None


@contextmanager
def naming(settings: Settings | Path | None) -> Iterator[None]:
    """Name the user's file in an error of settings that only the problem reveals."""
    try:
        yield
    except CaseError as error:
        if error.file == SETTINGS and isinstance(settings, Path):
            raise CaseError(settings, error.place, error.expected) from None
        raise


def _odd_bounds(bounds: dict[str, Any]) -> str:
    """Return the name of the first bounds that are not two numbers."""
    for name, pair in bounds.items():
        try:
            msgspec.convert(pair, tuple[float, float])
        except msgspec.ValidationError:
            return name
    raise AssertionError("msgspec has refused one of them")
