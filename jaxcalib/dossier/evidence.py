"""What a dossier is written from: the case, and what calibration, validation and diagnosis have left."""

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.run_folder import IDENTITY_FILE, files_elsewhere, files_within, read_identity
from jaxcalib.validation.calibrated_run import SAME, CalibratedRun, read_calibrated_run

FORMAT = 1
RESULT, VALIDATION, DIAGNOSIS = "result.json", "validation.json", "diagnosis.json"
SCENARIO = "scenario"  # folder in RUN with the calibrated files
STATED = (  # by people
    "purpose", "scope", "operational_design_domain", "criticality", "accuracy_requirement", "responsible", "review",
)  # fmt: skip


@dataclass(frozen=True)
class Evidence:
    """All that is there; None for what is not."""

    problem: CalibrationProblem
    result: Mapping[str, Any]  # of the calibration
    changes: tuple[str, ...]  # how case and program have changed since
    identity: Mapping[str, Any]  # what RUN was begun with; empty where that cannot be read
    validation: Mapping[str, Any] | None
    diagnosis: Mapping[str, Any] | None
    stated: Mapping[str, str]  # what people say of the use, by key of STATED
    unknown: tuple[str, ...]  # what does not say of which case it is, one line each
    files: Mapping[str, str]  # SHA-256 of each file of the case, of RUN and of what is quoted, by its path


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
    validated = _given(validation, run / "validation", VALIDATION)
    diagnosed = _given(diagnosis, run / "diagnosis", DIAGNOSIS)
    found_validation = None if validated is None else _read_json(validated)
    found_diagnosis = None if diagnosed is None else _read_json(diagnosed)
    identity = _identity_of(run)
    if validated is not None and found_validation is not None:
        _check_validation(validated, found_validation, problem, calibrated)
    unknown = [] if validated is None else _check_files(validated, identity, "validation")
    unknown += [] if diagnosed is None else _check_files(diagnosed, identity, "diagnosis")
    quoted = [file for file in (validated, diagnosed, statement) if file is not None]
    return Evidence(
        problem=problem,
        result=_read_json(run / RESULT),
        changes=calibrated.warnings,
        identity=identity,
        validation=found_validation,
        diagnosis=found_diagnosis,
        stated={} if statement is None else _read_statement(statement),
        unknown=tuple(unknown),
        files=_hashes(problem, run, quoted),
    )


def _given(named: Path | None, usual: Path, name: str) -> Path | None:
    """Return the file to read: that of a folder that was named, or one that may be there."""
    file = (named or usual) / name
    return file if named is not None or file.is_file() else None


def _identity_of(folder: Path) -> Mapping[str, Any]:
    try:
        return read_identity(folder / IDENTITY_FILE)
    except CaseError:
        return {}


def _check_validation(
    file: Path, found: Mapping[str, Any], problem: CalibrationProblem, calibrated: CalibratedRun
) -> None:
    """Refuse a validation of another case or of other values: it says nothing of these.

    Raises:
        CaseError: it is.
    """
    if found.get("case") != problem.case.name:
        expected = f"expected a validation of {quote(problem.case.name)}, got one of {quote(found.get('case'))}."
        raise CaseError(file, "case", expected)
    values = found.get("parameters")
    values = values if isinstance(values, dict) else {}
    names = problem.layout.names
    if set(values) != set(names) or not np.allclose(
        np.asarray([values[name] for name in names], float), calibrated.values, rtol=SAME, atol=SAME
    ):
        raise CaseError(file, "parameters", "expected the values of RUN/result.json; this validates others.")


def _check_files(file: Path, identity: Mapping[str, Any], what: str) -> list[str]:
    """Refuse a validation or diagnosis of another case; return what is not known, one line each.

    Raises:
        CaseError: it is.
    """
    theirs, ours = str(_identity_of(file.parent).get("case", "")), str(identity.get("case", ""))
    if not theirs or not ours:
        return [f"Whether the {what} is of this case: {IDENTITY_FILE} beside it or in RUN cannot be read."]
    (name, _, _), (own, _, _) = theirs.rpartition(" "), ours.rpartition(" ")
    if name != own:
        raise CaseError(file, "", f"expected a {what} of {quote(own)}, got one of {quote(name)}.")
    return [] if theirs == ours else [f"The {what} saw other files of the case than the calibration."]


def _hashes(problem: CalibrationProblem, run: Path, quoted: Sequence[Path]) -> Mapping[str, str]:
    """Return hashes by path: of all that the case consists of, of what RUN holds, and of what is quoted."""
    case = problem.case.folder
    own = [file for file in files_within(problem.case) if not _is_hidden(file.relative_to(case))]
    handed_over = [file for file in (run / SCENARIO).rglob("*") if file.is_file()]
    made = [file for file in (run / RESULT, run / IDENTITY_FILE) if file.is_file()]
    named = {_told(file, case, run): file for file in [*own, *files_elsewhere(problem.case), *made, *handed_over]}
    named |= {_told(file, case, run): file for file in quoted}
    return {name: _hash(named[name]) for name in sorted(named)}


def _is_hidden(file: Path) -> bool:
    return any(part.startswith(".") for part in file.parts)


def _told(file: Path, case: Path, run: Path) -> str:
    """Return where a file lies, from CASE or RUN where it is in one of them."""
    for name, folder in (("RUN", run.resolve()), ("CASE", case.resolve())):
        if file.resolve().is_relative_to(folder):
            return f"{name}/{file.resolve().relative_to(folder).as_posix()}"
    return str(file)


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
