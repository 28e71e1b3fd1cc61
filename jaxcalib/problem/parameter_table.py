"""Writes docs/parameters.md: every parameter with its names, unit, ranges and defaults, as the program has them.

`python -m jaxcalib.problem.parameter_table` writes the page anew.
"""

from collections.abc import Iterator
from pathlib import Path

from jaxcalib.problem.parameter_space import default_parameters, ranges_of
from sim_adapters.scenario.sumo_names import CLASS_DEFAULTS, SUMO_MODELS, attributes_of, parameter_of
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS

PAGE = Path(__file__).parents[2] / "docs" / "parameters.md"
PASSENGER = CLASS_DEFAULTS["passenger"]

INTRODUCTION = """# Parameters

Written by `python -m jaxcalib.problem.parameter_table`.

## Calibrated with traffic

What `[behaviour].parameters` and `[bounds]` may name: SUMO's vType attributes, and what they are in the surrogate. A
star marks what is calibrated where the case names nothing, "log" a logarithmic scale. Defaults are SUMO's for passenger
cars. Diagnosis takes slopes over steps of this share of the value.
"""
PAIRS = """
## Fitted to leader-follower pairs

What `jaxcalib fit-following --model` fits, and what `[subject].parameters` may set. These are values of one driver; his
range is not that of a whole class in traffic.
"""


def page() -> str:
    """Return the page."""
    lines = [INTRODUCTION, *_head("attribute", "models", "parameter", "default", "bounds", "unit", "step")]
    lines += _traffic_rows()
    lines += [PAIRS, *_head("parameter", "models", "usual", "range", "unit")]
    lines += _pair_rows()
    lines += ["", "Sources of the ranges:", ""]
    for source in dict.fromkeys(entry.source for entry in CAR_FOLLOWING_MODELS if entry.source):
        lines.append(f"- {_names(entry.name for entry in CAR_FOLLOWING_MODELS if entry.source == source)}: {source}")
    return "\n".join([*lines, ""])


def _traffic_rows() -> Iterator[str]:
    """Yield a line for each attribute, one for all models that share it."""
    models: dict[tuple[str, ...], list[str]] = {}
    for model in SUMO_MODELS:
        ranges = ranges_of(model)
        for name, attribute in attributes_of(model).items():
            row = parameter_of(model, attribute)
            if row is None:
                continue
            one, default = ranges[name], PASSENGER.get(name, attribute.default)
            bounds = f"{one.lower:g} to {one.upper:g}{', log' if one.is_logarithmic else ''}"
            text = "as `lcCooperative`" if default is None else f"{default:g}"
            models.setdefault((name, row.name, text, bounds, one.unit, f"{row.step:g}"), []).append(model)
    for (name, *rest), having in models.items():
        starred = [model for model in having if name in default_parameters(model)]
        marked = (f"{model} *" if model in starred else model for model in having)
        yield _line(f"`{name}`", "all *" if len(starred) == len(SUMO_MODELS) else ", ".join(marked), *rest)


def _pair_rows() -> Iterator[str]:
    """Yield a line for each parameter, one for all models that share it."""
    models: dict[tuple[str, ...], list[str]] = {}
    for entry in CAR_FOLLOWING_MODELS:
        for row in entry.parameters:
            cells = (row.name, f"{row.usual:g}", f"{row.lower:g} to {row.upper:g}", row.unit)
            models.setdefault(cells, []).append(entry.name)
    for (name, *rest), having in models.items():
        yield _line(f"`{name}`", ", ".join(having), *rest)


def _names(names: Iterator[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _head(*names: str) -> tuple[str, str]:
    return _line(*names), "|" + "---|" * len(names)


def _line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
