"""What a dossier is written from: the case, and what calibration, validation and diagnosis have left."""

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.calibrated_run import read_calibrated_run

FORMAT = 1
RESULT, VALIDATION, DIAGNOSIS = "result.json", "validation.json", "diagnosis.json"
STATED = ("purpose", "scope", "operational_design_domain", "criticality", "responsible", "review")  # by people


@dataclass(frozen=True)
class Evidence:
    """All that is there; None for what is not."""

    problem: CalibrationProblem
    result: Mapping[str, Any]  # of the calibration
    changes: tuple[str, ...]  # how case and program have changed since
    validation: Mapping[str, Any] | None
    diagnosis: Mapping[str, Any] | None
    stated: Mapping[str, str]  # what people say of the use, by key of STATED
    files: Mapping[str, str]  # SHA-256 of each file that is quoted


def gather_evidence(
    case: Path, run: Path, validation: Path | None, diagnosis: Path | None, statement: Path | None
) -> Evidence:
    """Read what there is.

    Args:
        case: the case's folder.
        run: folder that the calibration has left.
        validation: folder of the validation; RUN/validation unless given.
        diagnosis: folder of the diagnosis; RUN/diagnosis unless given.
        statement: TOML file in which people say what the simulation is for.

    Raises:
        CaseError: the case or a file is wrong, or a file that was named is not there.
    """
    problem = read_problem(case)
    calibrated = read_calibrated_run(run, problem)
    files = [case / "case.toml", run / RESULT]
    read: list[Mapping[str, Any] | None] = []
    for given, folder, name in ((validation, "validation", VALIDATION), (diagnosis, "diagnosis", DIAGNOSIS)):
        file = (given or run / folder) / name
        if given is None and not file.is_file():
            read.append(None)
            continue
        read.append(_read_json(file))
        files.append(file)
    if statement is not None:
        files.append(statement)
    drives = problem.case.drives
    files += [file for drive in drives for file in (drive.subject_file, drive.objects_file)]
    return Evidence(
        problem=problem,
        result=_read_json(run / RESULT),
        changes=calibrated.warnings,
        validation=read[0],
        diagnosis=read[1],
        stated={} if statement is None else _read_statement(statement),
        files={file.name: _hash(file) for file in files},
    )


def _read_json(file: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError:
        raise CaseError(file, "", f"expected this file in the folder {quote(str(file.parent))}; none there.") from None
    except ValueError:
        raise CaseError(file, "", "expected a result of jaxcalib; it cannot be read.") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CaseError(file, "format", f"expected {FORMAT}, the format that this version reads.")
    return content


def _read_statement(file: Path) -> dict[str, str]:
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError:
        raise CaseError(file, "", "expected a TOML file; there is none.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CaseError(file, "", f"expected TOML: {error}") from None
    for key, text in content.items():
        if key not in STATED:
            raise CaseError(file, key, f"expected one of {', '.join(STATED)}.")
        if not isinstance(text, str) or not text.strip():
            raise CaseError(file, key, "expected a text.")
    return content


def _hash(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
