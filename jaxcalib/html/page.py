"""Pages for people: one file each, without scripts or anything from outside."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

FOLDER = Path(__file__).parent


def render_page(template: str, **content: Any) -> str:
    """Return a page.

    Args:
        template: file in this folder.
        content: what it shows; text is escaped unless it is markupsafe's Markup.
    """
    environment = Environment(
        loader=FileSystemLoader(FOLDER), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template(template).render(percent=percent, **content)


def percent(value: float | None) -> str:
    """Return a fraction in per cent."""
    return "-" if value is None else f"{100.0 * value:.1f} %"
