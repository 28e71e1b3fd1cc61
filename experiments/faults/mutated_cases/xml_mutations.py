"""Mutations of SUMO's XML: elements and attributes left out, doubled, renamed or odd; tags not closed, deep nesting.

A mutation that finds nothing to change says nothing of what it has done.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping

import numpy as np

TreeMutation = Callable[[ET.Element, np.random.Generator], str]
TextMutation = Callable[[str, np.random.Generator], tuple[str, str]]
ODD_VALUES = (
    "", "abc", "-1", "0", "-0.5", "nan", "inf", "1e308", "-1e308", "99999999999999999999", "0.0001", "1e7", "true",
    "x" * 5000, "💥", "a b", "/etc/passwd", "../..", ";", ",,", "1,2", "<script>", "m2", "m2 m2", "ego", "car", ":",
    "#", "-", "max", "random", "exp(1)",
)  # fmt: skip
ODD_BEGINS = (
    '<?xml version="1.0" encoding="UTF-16"?>', '<?xml version="9.9"?>', '<?xml version="1.0" encoding="none"?>',
    '<!DOCTYPE x [<!ENTITY a "b">]>', "\n\n<?xml version='1.0'?>",
)  # fmt: skip
DEPTH = 5000


def _element(root: ET.Element, chance: np.random.Generator) -> ET.Element:
    """Return any element; each tag is as likely as another, however many there are of it."""
    tags = sorted({element.tag for element in root.iter()})
    elements = list(root.iter(str(chance.choice(tags))))
    return elements[int(chance.integers(len(elements)))]


def _named(element: ET.Element) -> str:
    return f"{element.tag} {element.get('id', '')}".strip()


def _parent_of(root: ET.Element, child: ET.Element) -> ET.Element | None:
    return next((element for element in root.iter() if child in list(element)), None)


def _attribute(element: ET.Element, chance: np.random.Generator) -> str | None:
    return str(chance.choice(sorted(element.attrib))) if element.attrib else None


def odd_value(root: ET.Element, chance: np.random.Generator) -> str:
    """Give an attribute an odd value."""
    element = _element(root, chance)
    name, value = _attribute(element, chance) or "id", str(chance.choice(ODD_VALUES))
    if element.get(name) == value:
        return ""
    element.set(name, value)
    return f"{_named(element)[:60]}: {name}={value[:30]!r}"


def attribute_dropped(root: ET.Element, chance: np.random.Generator) -> str:
    """Leave out an attribute."""
    element = _element(root, chance)
    name = _attribute(element, chance)
    if name is None:
        return ""
    del element.attrib[name]
    return f"{_named(element)}: without {name}"


def attribute_renamed(root: ET.Element, chance: np.random.Generator) -> str:
    """Misspell an attribute."""
    element = _element(root, chance)
    name = _attribute(element, chance)
    if name is None:
        return ""
    element.set(name.upper(), element.attrib.pop(name))
    return f"{_named(element)}: {name} in capitals"


def other_sign(root: ET.Element, chance: np.random.Generator) -> str:
    """Turn the sign of a number, or multiply it: negative lengths, speeds in km/h."""
    found = [
        (element, name)
        for element in root.iter()
        for name, value in element.attrib.items()
        if re.fullmatch(r"[\d.]+", value) and value.count(".") < 2 and value != "."
    ]
    if not found:
        return ""
    element, name = found[int(chance.integers(len(found)))]
    factor = float(chance.choice([-1.0, 0.0, 3.6, 1e3, 1e-3]))
    element.set(name, f"{factor * float(element.attrib[name]):g}")
    return f"{_named(element)}: {name}={element.get(name)}"


def element_dropped(root: ET.Element, chance: np.random.Generator) -> str:
    """Leave out an element."""
    element = _element(root, chance)
    parent = _parent_of(root, element)
    if parent is None:
        root.clear()
    else:
        parent.remove(element)
    return f"{_named(element)} dropped"


def element_twice(root: ET.Element, chance: np.random.Generator) -> str:
    """Have an element twice, with its id."""
    element = _element(root, chance)
    parent = _parent_of(root, element)
    if parent is None:
        return ""
    parent.append(element)
    return f"{_named(element)} twice"


def element_renamed(root: ET.Element, chance: np.random.Generator) -> str:
    """Make another element of one."""
    element = _element(root, chance)
    before, tag = (
        _named(element),
        str(chance.choice(["vType", "flow", "edge", "unknown", "configuration", "routes", "vehicle", "net"])),
    )
    if tag == element.tag:
        return ""
    element.tag = tag
    return f"{before} is a {tag}"


def element_moved(root: ET.Element, chance: np.random.Generator) -> str:
    """Put an element into another one."""
    element, into = _element(root, chance), _element(root, chance)
    parent = _parent_of(root, element)
    if parent is None or into in list(element.iter()):
        return ""
    parent.remove(element)
    into.append(element)
    return f"{_named(element)} within {_named(into)}"


def tag_not_closed(text: str, chance: np.random.Generator) -> tuple[str, str]:
    """Leave out the end of a tag."""
    ends = [match.span() for match in re.finditer(r"/>|</\w+>|>", text)]
    if not ends:
        return text, ""
    begin, end = ends[int(chance.integers(len(ends)))]
    return text[:begin] + text[end:], f"without '{text[begin:end]}' at {begin}"


def deep(text: str, chance: np.random.Generator) -> tuple[str, str]:
    """Nest elements deeply before the end."""
    place = text.rfind("</")
    return text[:place] + "<x>" * DEPTH + "</x>" * DEPTH + text[place:], f"{DEPTH} elements nested"


def odd_letters(text: str, chance: np.random.Generator) -> tuple[str, str]:
    """Put letters somewhere that mean something in XML."""
    place = int(chance.integers(len(text) + 1))
    letters = str(chance.choice(["&", "<", ">", '"', "&#0;", "&amp", "]]>", "<!--", "<![CDATA[", "\x01", "<?x", "&x;"]))
    return text[:place] + letters + text[place:], f"{letters!r} at {place}"


def other_declaration(text: str, chance: np.random.Generator) -> tuple[str, str]:
    """Say that it is in another encoding, or give it a document type."""
    body = re.sub(r"^\s*<\?xml.*?\?>", "", text, flags=re.DOTALL)
    first = str(chance.choice(ODD_BEGINS))
    return first + body, f"begins with {first!r}"


TREE_MUTATIONS: Mapping[str, TreeMutation] = {
    function.__name__: function
    for function in (
        odd_value, attribute_dropped, attribute_renamed, other_sign, element_dropped, element_twice, element_renamed,
        element_moved,
    )
}  # fmt: skip
TEXT_MUTATIONS: Mapping[str, TextMutation] = {
    function.__name__: function for function in (tag_not_closed, deep, odd_letters, other_declaration)
}
