"""Where a hostile case lies, with what it must not touch, and the small steps by which it is made hostile."""

import re
from dataclasses import dataclass
from pathlib import Path

from jaxcalib.case.case_file import FILE_NAME

SCENARIO = Path("scenario")


@dataclass(frozen=True)
class Place:
    """The folder of a trial: the case, what lies around it, and RUN, which alone may be written to."""

    folder: Path  # all of it

    @property
    def case(self) -> Path:
        """The case."""
        return self.folder / "case"

    @property
    def outside(self) -> Path:
        """A folder beside the case that a hostile case aims at."""
        return self.folder / "outside"

    @property
    def run(self) -> Path:
        """Where results go."""
        return self.folder / "run"

    @property
    def demand(self) -> Path:
        """The route file."""
        return self.case / SCENARIO / "demand.rou.xml"

    @property
    def net(self) -> Path:
        """The network."""
        return self.case / SCENARIO / "net.net.xml"

    @property
    def config(self) -> Path:
        """The configuration."""
        return self.case / SCENARIO / "scenario.sumocfg"

    @property
    def toml(self) -> Path:
        """What describes the case."""
        return self.case / FILE_NAME

    @property
    def log(self) -> Path:
        """The subject vehicle's table of the first drive."""
        return self.case / "field" / "d01_subject.parquet"


def replace(file: Path, old: str, new: str, count: int = -1) -> None:
    """Replace text in a file.

    Raises:
        ValueError: it is not there, so that the attack would be none.
    """
    text = file.read_text(encoding="utf-8")
    if old not in text:
        raise ValueError(f"{file.name} has no {old!r}")
    file.write_text(text.replace(old, new, count), encoding="utf-8")


def add_option(place: Place, option: str, value: str) -> None:
    """Add an option to the configuration, in a section that SUMO does not care for."""
    replace(place.config, "</configuration>", f'<more><{option} value="{value}"/></more></configuration>')


def add_file(place: Place, name: str, elements: str) -> Path:
    """Add an additional file to the scenario."""
    file = place.config.with_name(name)
    file.write_text(f"<additional>{elements}</additional>\n", encoding="utf-8")
    replace(place.config, "<input>", f'<input><additional-files value="{name}"/>')
    return file


def add_to_demand(place: Place, elements: str) -> None:
    """Add elements at the begin of the route file."""
    replace(place.demand, "<routes>", f"<routes>{elements}", 1)


def first_lane(place: Place) -> str:
    """Return a lane of the subject vehicle's route."""
    found = re.search(r'<lane id="(m3_0)"', place.net.read_text(encoding="utf-8"))
    if found is None:
        raise ValueError("the network has no lane m3_0")
    return found[1]
