"""The site: `sphinx-build -W --keep-going docs site`. Every warning, so every dead link, ends the build."""

import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx

from surrogate.effects.base import Effect
from surrogate.effects.registry import EFFECTS

sys.path.append(str(Path(__file__).parent))

import parameter_tables

RECORDS = Path(__file__).parents[1] / "experiments" / "results"

project = "jaxcalib"
version = release = version_of("jaxcalib")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode", "cyclopts.ext.sphinx"]
highlight_language = "none"
html_theme = "furo"
html_title = f"jaxcalib {version}"
html_show_copyright = False
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 4
autodoc_typehints = "signature"
autodoc_default_options = {"members": False}
napoleon_use_ivar = True
napoleon_custom_sections = ["Source", "Deviation"]


def setup(app: Sphinx) -> None:
    """Let pages be completed from the program and from the records when they are read."""
    app.connect("source-read", complete)


def complete(app: Sphinx, page: str, source: list[str]) -> None:
    """Put in what the repository shows elsewhere: the tables of records, effects and parameters.

    Links to a record, which lead to its file in the repository, lead to its place on the page of records.
    """
    text = re.sub(r"\.\./experiments/results/(\w+)\.md", r"records.md#record-\1", source[0])
    text = re.sub(r"\[([^\]]*)\]\(\.\./[A-Z]+\.md\)", r"\1", text)
    if page == "records":
        text += "".join(record(file) for file in sorted(RECORDS.glob("*.md")))
    text = text.replace("<!-- table of effects -->", table_of_effects())
    source[0] = parameter_tables.completed(text) if page == "parameters" else text


def record(file: Path) -> str:
    """Return what includes a record one heading lower, with a place to link to."""
    included = f"../experiments/results/{file.name}\n:heading-offset: 1\n:relative-images:"
    return f"\n(record-{file.stem})=\n```{{include}} {included}\n```\n"


def table_of_effects() -> str:
    """Return all effects of the registry."""
    head = ["effect", "acts on", "unit of its strength", "weak / medium / strong", "also"]
    rows = [[f"`{one.name}`", str(one.acts_on), one.unit, strengths(one), also(one)] for one in EFFECTS]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def strengths(effect: Effect) -> str:
    """Return the strengths as people count them: a factor counts from 1."""
    return " / ".join(f"{effect.reported_at_zero + each:g}" for each in (effect.weak, effect.medium, effect.strong))


def also(effect: Effect) -> str:
    """Return what else an effect can be told."""
    words = (
        "place" if effect.has_place else "",
        "time" if effect.has_time else "",
        "sign" if effect.is_signed else "",
        f"choice: {effect.choice}" if effect.choice else "",
        f"time constant: {effect.time_constant}" if effect.time_constant else "",
    )
    return "; ".join(word for word in words if word)
