"""Names that are markup, formulas, control sequences or paths: of the case, its drives, inputs, vTypes and files."""

from collections.abc import Callable, Mapping

from experiments.faults.hostile.place import Place, replace

Hostile = Callable[[Place], None]
MARKER = "jxmark"
SCRIPT, IMAGE = f"<script>{MARKER}()</script>", f"<img src=x onerror={MARKER}()>"
BREAKING = f"'\\\"></svg></style></title>{SCRIPT}"
RAW = (SCRIPT, IMAGE, f"</title>{SCRIPT[:8]}", f"<b/onclick={MARKER}")


def _in_xml(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")


def case_name(name: str) -> Hostile:
    """Return what gives the case another name."""
    return lambda place: replace(place.toml, 'name = "small"', f'name = "{name}"')


def drive_id(name: str) -> Hostile:
    """Return what gives a drive another id."""
    return lambda place: replace(place.toml, 'id       = "d01"', f'id       = "{name}"')


def input_id(place: Place) -> None:
    """Give an input such an id."""
    replace(place.toml, 'id    = "main"', f'id    = "{IMAGE}"')


def vtype_id(place: Place) -> None:
    """Give the drivers' vType such an id."""
    for element in ('vType id="', 'type="'):
        replace(place.demand, f'{element}car"', f'{element}{_in_xml(SCRIPT)}"')
    replace(place.toml, 'vtypes = ["car"]', f'vtypes = ["{SCRIPT}"]')


def flow_id(place: Place) -> None:
    """Give a flow such an id."""
    replace(place.demand, 'id="f_main"', f'id="{_in_xml(IMAGE)}"')
    replace(place.toml, '"f_main"', f'"{IMAGE}"')


def edge_id(place: Place) -> None:
    """Give an edge such an id, throughout the scenario."""
    for file in (place.net, place.demand):
        text = file.read_text(encoding="utf-8")
        for before, after in (('"m3"', '"{}"'), ("m3_", "{}_"), (" m3 ", " {} "), ('"m3 ', '"{} '), (' m3"', ' {}"')):
            text = text.replace(before, after.format(_in_xml("<b onclick=" + MARKER + "()>").replace(" ", "/")))
        file.write_text(text, encoding="utf-8")


def file_name(place: Place) -> None:
    """Give a log and the route file such names."""
    name = IMAGE.replace("/", "")
    place.log.rename(place.log.with_name(f"{name}.parquet"))
    replace(place.toml, "d01_subject.parquet", f"{name}.parquet")
    place.demand.rename(place.demand.with_name(f"{name}.rou.xml"))
    replace(place.config, "demand.rou.xml", f"{_in_xml(name)}.rou.xml")


def refused_value(place: Place) -> None:
    """Have a message quote such a text."""
    replace(place.demand, 'departLane="best"', f'departLane="{_in_xml(SCRIPT)}"', 1)


def refused_key(place: Place) -> None:
    """Have a message quote such a key."""
    replace(place.toml, 'reference = "front"', f'reference = "{SCRIPT}"')


NAMES: Mapping[str, Hostile] = {
    "markup as the case's name": case_name(SCRIPT),
    "markup that breaks out as the case's name": case_name(BREAKING),
    "path as the case's name": case_name("../../outside/x"),
    "control sequence as the case's name": case_name("\\u001b[2J\\u001b]0;x\\u0007\\r\\nfake"),
    "markup as a drive's id": drive_id(IMAGE),
    "path as a drive's id": drive_id("../../outside/x"),
    "markup as an input's id": input_id,
    "markup as a vType's id": vtype_id,
    "markup as a flow's id": flow_id,
    "markup as an edge's id": edge_id,
    "markup as names of files": file_name,
    "markup in a value that SUMO refuses": refused_value,
    "markup in a value of case.toml": refused_key,
}
