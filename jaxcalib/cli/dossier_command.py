"""`jaxcalib dossier` as a person meets it: messages and exit codes."""

from pathlib import Path

from jaxcalib.cli.guarded import guarded
from jaxcalib.dossier.dossier import FOLDER, Dossier, write_dossier


def run_dossier(
    case: Path,
    run: Path,
    out: Path | None,
    validation: Path | None,
    diagnosis: Path | None,
    statement: Path | None,
    *,
    quiet: bool,
) -> int:
    """Write the dossier and return the exit code."""
    folder = out or run / FOLDER

    def work() -> str:
        written = write_dossier(case, run, out, validation_run=validation, diagnosis_run=diagnosis, statement=statement)
        return "" if quiet else _summary(written, folder)

    return guarded(work, "", folder)


def _summary(dossier: Dossier, folder: Path) -> str:
    lines = [""]
    for section in dossier.sections:
        missing = f"{len(section.missing)} missing" if section.missing else "nothing missing"
        against = f", {len(section.failures)} against it" if section.failures else ""
        lines.append(f"  {section.heading}: {missing}{against}")
    return "\n".join([*lines, "", f"document: {folder / 'dossier.html'}"])
