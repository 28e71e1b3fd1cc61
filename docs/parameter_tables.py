"""The tables of docs/parameters.md: every parameter with its names, unit, ranges and defaults, as the program has them.

The site has them in place of the comments of that page; `python docs/parameter_tables.py` prints the page with them.
"""

from collections.abc import Iterator
from pathlib import Path

from jaxcalib.problem.parameter_space import default_parameters, ranges_of
from sim_adapters.scenario.sumo_names import CLASS_DEFAULTS, SUMO_MODELS, attributes_of, parameter_of
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS

PAGE = Path(__file__).parent / "parameters.md"
PASSENGER = CLASS_DEFAULTS["passenger"]


def completed(text: str) -> str:
    """Return a page with tables in place of its comments."""
    traffic = [*_head("attribute", "models", "parameter", "default", "bounds", "unit", "step"), *_traffic_rows()]
    pairs = [*_head("parameter", "models", "usual", "range", "unit"), *_pair_rows()]
    sources = dict.fromkeys(entry.source for entry in CAR_FOLLOWING_MODELS if entry.source)
    listed = [
        f"- {_names(entry.name for entry in CAR_FOLLOWING_MODELS if entry.source == source)}: {source}"
        for source in sources
    ]
    for name, lines in (
        ("table of parameters in traffic", traffic),
        ("table of parameters of pairs", pairs),
        ("sources of ranges", listed),
    ):
        text = text.replace(f"<!-- {name} -->", "\n".join(lines))
    return text


def _traffic_rows() -> Iterator[str]:
    """Yield a line for each attribute, one for all models that share it."""
    models: dict[tuple[str, ...], list[str]] = {}
    for model in SUMO_MODELS:
        ranges = ranges_of(model)
        for name, attribute in attributes_of(model).items():
            row = parameter_of(model, attribute)
            if row is None:
                continue
            searched, default = ranges[name], PASSENGER.get(name, attribute.default)
            bounds = f"{searched.lower:g} to {searched.upper:g}{', log' if searched.is_logarithmic else ''}"
            text = "as `lcCooperative`" if default is None else f"{default:g}"
            models.setdefault((name, row.name, text, bounds, searched.unit, f"{row.step:g}"), []).append(model)
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
    print(completed(PAGE.read_text(encoding="utf-8")))
