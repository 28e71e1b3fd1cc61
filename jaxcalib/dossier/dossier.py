"""Writes the dossier: nothing is claimed that a file does not show, and what is missing is named under its heading.

Source: headings after the credibility assessment of virtual toolchains, Commission Implementing Regulation (EU)
2022/1426, Annex III, part 4, and UNECE, New Assessment/Test Method for Automated Driving (NATM), 2023.
"""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxcalib.dossier.calibration import calibration
from jaxcalib.dossier.evidence import FORMAT, gather_evidence
from jaxcalib.dossier.gap import gap
from jaxcalib.dossier.section import Section
from jaxcalib.dossier.trust import numerical_error, provenance
from jaxcalib.dossier.use_and_data import data, model_and_limits, purpose_and_scope
from jaxcalib.dossier.validation import validation
from jaxcalib.html.page import render_page
from jaxcalib.runs.disk import check_out, check_outside, writing_to
from sim_adapters.atomic_file import write_atomically

FOLDER = "dossier"
LARGEST_WHOLE = 1e9  # counts are told in full
HEADINGS = (
    purpose_and_scope, data, model_and_limits, calibration, validation, gap, numerical_error, provenance,
)  # fmt: skip


@dataclass(frozen=True)
class Dossier:
    """What an assessor reads."""

    case: str  # name of the case
    sections: tuple[Section, ...]

    @property
    def num_missing(self) -> int:
        """How many things are missing."""
        return sum(len(section.missing) for section in self.sections)

    @property
    def num_failures(self) -> int:
        """How many things speak against the simulation."""
        return sum(len(section.failures) for section in self.sections)

    def to_json(self) -> str:
        """The dossier as JSON."""
        content: dict[str, Any] = {"format": FORMAT, "case": self.case}
        content["sections"] = [dataclasses.asdict(section) for section in self.sections]
        return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def write_dossier(
    case: Path | str,
    run: Path | str,
    out: Path | str | None = None,
    *,
    validation_run: Path | str | None = None,
    diagnosis_run: Path | str | None = None,
    statement: Path | str | None = None,
) -> Dossier:
    """Write dossier.html and dossier.json from what calibration, validation and diagnosis have left.

    Args:
        case: the case's folder.
        run: RUN, the folder that the calibration has left.
        out: folder for both files; RUN/dossier unless given.
        validation_run: folder of the validation; RUN/validation, if there is one, unless given.
        diagnosis_run: folder of the diagnosis; RUN/diagnosis, if there is one, unless given.
        statement: TOML file in which people say what the simulation is for (`evidence.STATED`).

    Raises:
        CaseError: the case or a file is wrong; one line says what.
        ResourceError: the disk is full.
    """
    folder = Path(run) / FOLDER if out is None else Path(out)
    check_outside(folder, Path(case))
    check_out(folder)
    given = [None if each is None else Path(each) for each in (validation_run, diagnosis_run, statement)]
    evidence = gather_evidence(Path(case), Path(run), *given)
    dossier = Dossier(evidence.problem.case.name, tuple(heading(evidence) for heading in HEADINGS))
    page = render_page("dossier.html.j2", dossier=dossier, number=_number)
    with writing_to(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in (("dossier.json", dossier.to_json()), ("dossier.html", page)):
            write_atomically(folder / name, lambda stream, text=text: stream.write(text.encode()))
    return dossier


def _number(value: str | float | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if float(value).is_integer() and abs(value) < LARGEST_WHOLE else f"{value:.4g}"
