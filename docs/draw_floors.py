"""`python docs/draw_floors.py`: draw the picture of the architecture from the layer contracts of pyproject.toml."""

import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "architecture.svg"
COLORS = {"experiments": "#f3f0e6", "jaxcalib": "#e3eefa", "sim_adapters": "#e8f4e4", "surrogate": "#fbeadf"}
WIDTH, MARGIN, NAME_WIDTH = 760, 10, 130
ROOM_HEIGHT, GAP = 26, 6


def floors() -> list[tuple[str, list[list[str]]]]:
    """Return the packages from the top down, each with its floors of rooms."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = [contract for contract in contracts if contract["type"] == "layers"]
    packages = next(contract["layers"] for contract in layers if "containers" not in contract)
    inside = {contract["containers"][0]: contract["layers"] for contract in layers if "containers" in contract}
    return [(name, [split(floor) for floor in inside.get(name, [])]) for name in packages]


def split(floor: str) -> list[str]:
    """Return the rooms of a floor, with what they hold on floors of their own not shown."""
    return [room.strip(" ()") for room in floor.replace(":", "|").split("|")]


def drawing() -> str:
    """Return the picture as SVG."""
    parts, top = [], MARGIN
    for package, rooms in floors():
        height = max(1, len(rooms)) * (ROOM_HEIGHT + GAP) + GAP
        parts.append(_box(MARGIN, top, WIDTH - 2 * MARGIN, height, COLORS.get(package, "#eeeeee")))
        parts.append(_text(MARGIN + 12, top + height / 2, package, "start", "bold"))
        for number, floor in enumerate(rooms):
            width = (WIDTH - 2 * MARGIN - NAME_WIDTH - GAP * len(floor)) / len(floor)
            for place, room in enumerate(floor):
                left = MARGIN + NAME_WIDTH + place * (width + GAP)
                at = top + GAP + number * (ROOM_HEIGHT + GAP)
                parts.append(_box(left, at, width, ROOM_HEIGHT, "#ffffff"))
                parts.append(_text(left + width / 2, at + ROOM_HEIGHT / 2, room, "middle"))
        top += height + GAP
    size = f'width="{WIDTH}" height="{top + MARGIN - GAP}" viewBox="0 0 {WIDTH} {top + MARGIN - GAP}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="13">'
    ground = f'<rect width="{WIDTH}" height="{top + MARGIN - GAP}" fill="#ffffff"/>'
    return "\n".join([head, "<title>Floors: imports only go down</title>", ground, *parts, "</svg>"]) + "\n"


def _box(left: float, top: float, width: float, height: float, color: str) -> str:
    shape = f'x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}"'
    return f'<rect {shape} rx="4" fill="{color}" stroke="#777777"/>'


def _text(left: float, middle: float, words: str, anchor: str, weight: str = "normal") -> str:
    place = f'x="{left:g}" y="{middle:g}" dominant-baseline="central" text-anchor="{anchor}" font-weight="{weight}"'
    return f'<text {place} fill="#222222">{escape(words)}</text>'


if __name__ == "__main__":
    PICTURE.write_text(drawing(), encoding="utf-8")
