"""Designs: which parameter sets a sweep runs."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.problem.parameter_space import ParameterSpace
from jaxcalib.search.orthogonal_arrays.orthogonal_array import array_sizes, orthogonal_array
from jaxcalib.sweeps.own_table import is_table, read_own_table

PLACE = "--design"
COMMAND_LINE = "command line"
MOST_CANDIDATES = 10_000_000
MOST_NAMES = 180  # characters, so that a message has room for what was asked for
KINDS = "sobol:N, latin-hypercube:N, grid:LEVELS, orthogonal-array:LEVELS, or a table (.csv, .csv.gz, .parquet)"
ALIASES = {"lhs": "latin-hypercube", "oa": "orthogonal-array"}

Unit = Float[np.ndarray, "candidate varied"]


@dataclass(frozen=True)
class Design:
    """Parameter sets to run."""

    name: str  # as the user wrote it; for an orthogonal array also Taguchi's notation
    varied: tuple[str, ...]  # names of the parameters that vary; the others have the scenario's values
    values: Float[np.ndarray, "candidate parameter"]  # parameter values of each candidate, in the order of the layout
    warnings: tuple[str, ...] = ()  # what a user should know of it


def make_design(
    text: str, space: ParameterSpace, base: Float[np.ndarray, " parameter"], chosen: Sequence[str] | None, seed: int
) -> Design:
    """Return the design that a user asks for.

    Args:
        text: kind and size, for example "sobol:4096"; or the path of a table.
        space: bounds and scales of the parameters; a design is even on these scales.
        base: values of the parameters that do not vary.
        chosen: names of the parameters that vary; None for all.
        seed: of designs that are random.

    Raises:
        CaseError: the kind or the size is not known, or the design does not support so many parameters.
    """
    if is_table(text):
        if chosen is not None:
            raise CaseError(
                COMMAND_LINE, "--parameters", "expected none beside a table, whose columns say what varies."
            )
        values, varied = read_own_table(text, space, base)
        _check_size(len(values), text)
        return Design(text, varied, values)
    kind, _, size = text.partition(":")
    kind = ALIASES.get(kind, kind)
    if kind not in _MAKERS:
        raise CaseError(COMMAND_LINE, PLACE, f"expected {KINDS}; got {quote(text)}.")
    varied = _varied(space, chosen)
    name, unit, notes = _MAKERS[kind](text, size, len(varied), seed)
    values = np.tile(np.asarray(base, float), (len(unit), 1))
    full = np.zeros((len(unit), len(space.names)))
    places = [space.index(one) for one in varied]
    full[:, places] = unit
    values[:, places] = space.values_of(full)[:, places]
    return Design(name, varied, values, notes)


def _sobol(text: str, size: str, num_varied: int, seed: int) -> tuple[str, Unit, tuple[str, ...]]:
    """Scrambled Sobol points (Owen 1998), as scipy has them."""
    count = _count(text, size)
    if num_varied > qmc.Sobol.MAXDIM:
        raise _too_many(text, qmc.Sobol.MAXDIM, num_varied)
    sampler = qmc.Sobol(num_varied, rng=np.random.default_rng(seed))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of numbers that are no power of 2; said below in our words
        unit = sampler.random(count)
    if count & (count - 1):
        return text, unit, (f"{text}: Sobol points are even only in powers of 2; {1 << count.bit_length()} is next.",)
    return text, unit, ()


def _latin_hypercube(text: str, size: str, num_varied: int, seed: int) -> tuple[str, Unit, tuple[str, ...]]:
    count = _count(text, size)
    return text, qmc.LatinHypercube(num_varied, rng=np.random.default_rng(seed)).random(count), ()


def _grid(text: str, size: str, num_varied: int, seed: int) -> tuple[str, Unit, tuple[str, ...]]:
    """Every combination of levels, bounds included: 5 for all parameters, or 5x3x2 one after another."""
    parts = size.split("x")
    if not all(part.isdecimal() and 2 <= int(part) <= 10_000 for part in parts):
        raise CaseError(COMMAND_LINE, PLACE, f"expected grid:LEVELS or grid:LEVELSxLEVELSx..., got {quote(text)}.")
    levels = [int(part) for part in parts]
    if len(levels) == 1:
        levels *= num_varied
    if len(levels) != num_varied:
        raise _too_many(text, len(levels), num_varied)
    cells = np.prod(np.asarray(levels, float))
    if cells > MOST_CANDIDATES:
        raise CaseError(
            COMMAND_LINE, PLACE, f"expected at most {MOST_CANDIDATES} candidates; {quote(text)} of {num_varied} "
            f"parameters has {cells:.3g}. Choose some with --parameters, or take sobol:N.",
        )  # fmt: skip
    return text, np.asarray(list(product(*(np.linspace(0.0, 1.0, one) for one in levels)))), ()


def _orthogonal_array(text: str, size: str, num_varied: int, seed: int) -> tuple[str, Unit, tuple[str, ...]]:
    """An array of strength 2, levels even over the bounds: LEVELS, or LEVELS:CASES for an array of that size."""
    parts = size.split(":")
    if len(parts) > 2 or not all(part.isdecimal() for part in parts):
        raise CaseError(
            COMMAND_LINE,
            PLACE,
            f"expected orthogonal-array:LEVELS or orthogonal-array:LEVELS:CASES, got {quote(text)}.",
        )
    num_levels = int(parts[0])
    try:
        sizes = dict(array_sizes(num_levels))
        if len(parts) == 2 and int(parts[1]) not in sizes:
            known = ", ".join(map(str, sizes))
            raise CaseError(COMMAND_LINE, PLACE, f"expected {known} cases at {num_levels} levels, got {parts[1]}.")
        if len(parts) == 2 and sizes[int(parts[1])] < num_varied:
            raise _too_many(text, sizes[int(parts[1])], num_varied)
        if max(sizes.values()) < num_varied:
            raise _too_many(text, max(sizes.values()), num_varied)
        array = orthogonal_array(num_varied, num_levels, int(parts[1]) if len(parts) == 2 else 0)
    except CaseError:
        raise
    except ValueError as error:
        raise CaseError(COMMAND_LINE, PLACE, f"{str(error)[0].lower()}{str(error)[1:]}") from None
    return f"{text}, {array.name}", array.levels / (num_levels - 1.0), ()


_MAKERS: Mapping[str, Callable[[str, str, int, int], tuple[str, Unit, tuple[str, ...]]]] = {
    "sobol": _sobol,
    "latin-hypercube": _latin_hypercube,
    "grid": _grid,
    "orthogonal-array": _orthogonal_array,
}


def _varied(space: ParameterSpace, chosen: Sequence[str] | None) -> tuple[str, ...]:
    if chosen is None:
        return space.names
    for index, name in enumerate(chosen):
        if name not in space.names:
            known = shorten(", ".join(space.names), MOST_NAMES)
            raise CaseError(COMMAND_LINE, "--parameters", f"expected some of {known}; got {quote(name)}.")
        if name in chosen[:index]:
            raise CaseError(COMMAND_LINE, "--parameters", f"expected each name once, got {quote(name)} again.")
    if not chosen:
        raise CaseError(COMMAND_LINE, "--parameters", "expected at least one name.")
    return tuple(chosen)


def _count(text: str, size: str) -> int:
    if not size.isdecimal() or not int(size):
        raise CaseError(COMMAND_LINE, PLACE, f"expected a number of candidates after the colon, got {quote(text)}.")
    _check_size(int(size), text)
    return int(size)


def _check_size(count: int, text: str) -> None:
    if not 1 <= count <= MOST_CANDIDATES:
        raise CaseError(COMMAND_LINE, PLACE, f"expected 1 to {MOST_CANDIDATES} candidates; {quote(text)} has {count}.")


def _too_many(text: str, most: int, num_varied: int) -> CaseError:
    return CaseError(
        COMMAND_LINE, PLACE, f"{quote(text)} supports {most} parameters; {num_varied} vary. Choose with --parameters, "
        "or take another design.",
    )  # fmt: skip
