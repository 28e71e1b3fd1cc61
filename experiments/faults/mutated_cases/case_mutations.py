"""Mutations of case.toml, line by line: values of other types, keys left out, doubled or unknown, odd tables."""

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

LineMutation = Callable[[list[str], np.random.Generator], str]
ODD_VALUES = (
    '""', '"abc"', "-1", "0", "1e308", "-1e308", "nan", "inf", "true", "[]", "{}", "[[1, 2], [3]]", "1979-05-27",
    '"../../etc/passwd"', '"/etc/passwd"', '"\\u0000"', '"' + "x" * 5000 + '"', "99999999999999999999", "0.1",
    '"\\u001b[2J"', '["a", 1]', "'''a\nb'''", '"field"', '"."',
)  # fmt: skip
ODD_LINES = (
    "unknown = 1", "[unknown]", "[[drive]]", "[scenario]", "format = 2", "name = 5", "a" * 200, "= 5", "x = ", "[[[",
    "\x00", "[log]", "[behaviour]\nvtypes = []", "deep = " + "[" * 500 + "]" * 500, "a." * 500 + "b = 1", '"" = 1',
    "💥 = 1",
)  # fmt: skip
KEY_VALUE = re.compile(r"^(\s*[\w.]+\s*=\s*)(.*)$", re.DOTALL)


def _place_of_value(lines: Sequence[str], chance: np.random.Generator) -> int:
    return int(chance.choice([place for place, line in enumerate(lines) if KEY_VALUE.match(line)]))


def odd_value(lines: list[str], chance: np.random.Generator) -> str:
    """Give a key an odd value."""
    place, value = _place_of_value(lines, chance), str(chance.choice(ODD_VALUES))
    key = lines[place].partition("=")[0]
    lines[place] = f"{key}= {value}"
    return f"line {place + 1}: {key.strip()} = {value[:30]!r}"


def negative(lines: list[str], chance: np.random.Generator) -> str:
    """Turn the sign of a number, or multiply it."""
    places = [place for place, line in enumerate(lines) if re.search(r"=\s*[\d.]+\s*$", line)]
    place, factor = int(chance.choice(places)), float(chance.choice([-1.0, 0.0, 3.6, 1e3, 1e-3, 1e9]))
    key, _, value = lines[place].partition("=")
    lines[place] = f"{key}= {factor * float(value)}"
    return f"line {place + 1}: {lines[place]}"


def line_dropped(lines: list[str], chance: np.random.Generator) -> str:
    """Leave out a line."""
    place = int(chance.integers(len(lines)))
    return f"line {place + 1} dropped: {lines.pop(place)}"


def line_twice(lines: list[str], chance: np.random.Generator) -> str:
    """Have a line twice."""
    place = int(chance.integers(len(lines)))
    lines.insert(place, lines[place])
    return f"line {place + 1} twice: {lines[place]}"


def line_moved(lines: list[str], chance: np.random.Generator) -> str:
    """Move a line to another section."""
    place, to = (int(one) for one in chance.integers(0, len(lines), 2))
    line = lines.pop(place)
    lines.insert(to, line)
    return f"line {place + 1} moved to {to + 1}: {line}"


def line_put_in(lines: list[str], chance: np.random.Generator) -> str:
    """Put in an odd line."""
    place, line = int(chance.integers(len(lines) + 1)), str(chance.choice(ODD_LINES))
    lines.insert(place, line)
    return f"line {place + 1} put in: {line[:30]!r}"


def key_misspelt(lines: list[str], chance: np.random.Generator) -> str:
    """Misspell a key."""
    place = _place_of_value(lines, chance)
    key, _, value = lines[place].partition("=")
    letter = int(chance.integers(len(key.strip())))
    lines[place] = f"{key[:letter]}{key[letter + 1 :]} = {value}"
    return f"line {place + 1}: {lines[place]}"


def section_dropped(lines: list[str], chance: np.random.Generator) -> str:
    """Leave out a whole section."""
    heads = [place for place, line in enumerate(lines) if line.startswith("[")]
    begin = int(chance.choice(heads))
    end = next((place for place in heads if place > begin), len(lines))
    name = lines[begin]
    del lines[begin:end]
    return f"section {name} dropped"


def values_exchanged(lines: list[str], chance: np.random.Generator) -> str:
    """Exchange the values of two keys: ids twice, files of others."""
    one, other = _place_of_value(lines, chance), _place_of_value(lines, chance)
    (key, _, value), (other_key, _, other_value) = lines[one].partition("="), lines[other].partition("=")
    lines[one] = f"{key}={other_value}"
    if chance.random() < 0.5:
        lines[other] = f"{other_key}={value}"
    return f"line {one + 1}: {lines[one]}"


CASE_MUTATIONS: Mapping[str, LineMutation] = {
    function.__name__: function
    for function in (
        odd_value, negative, line_dropped, line_twice, line_moved, line_put_in, key_misspelt, section_dropped,
        values_exchanged,
    )
}  # fmt: skip
