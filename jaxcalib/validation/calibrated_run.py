"""What a calibration has left in RUN, as far as a validation needs it."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.run_folder import IDENTITY_FILE, identify
from jaxcalib.validation.criterion import FORMAT
from sim_adapters.interface import ParameterLayout

RESULT_FILE = "result.json"
SAME = 1e-5  # of values that were multiplied by a factor and rounded


@dataclass(frozen=True)
class CalibratedRun:
    """A calibrated result."""

    values: tuple[float, ...]  # parameter values in the order of the layout
    first_seed: int  # first seed of the calibration that made it
    warnings: tuple[str, ...]  # how the case has changed since


def read_calibrated_run(run: Path, problem: CalibrationProblem) -> CalibratedRun:
    """Return the calibrated values of RUN, the folder that a calibration has left.

    Raises:
        CaseError: there is no result, it is of another format, or its parameters are not those of the case.
    """
    file = run / RESULT_FILE
    try:
        result = json.loads(file.read_text(encoding="utf-8"))
    except OSError:
        raise CaseError(
            file, "", f"expected the result of a calibration in {quote(str(run))}; there is none."
        ) from None
    except ValueError:
        raise CaseError(file, "", "expected the result of a calibration; it cannot be read.") from None
    if not isinstance(result, dict) or result.get("format") != FORMAT:
        raise CaseError(file, "format", f"expected {FORMAT}, the format that this version reads.")
    layout = problem.layout
    parameters = result.get("parameters")
    parameters = parameters if isinstance(parameters, dict) else {}
    demand = _numbers(file, "demand", parameters.get("demand"), layout.input_ids)
    of_vtypes = parameters.get("behaviour")
    of_vtypes = of_vtypes if isinstance(of_vtypes, dict) else {}
    if set(of_vtypes) != set(layout.vtypes):
        known = ", ".join(layout.vtypes)
        raise CaseError(file, "parameters.behaviour", f"expected the vTypes of the case, {known}; a result of another?")
    of_vtype = {vtype: _numbers(file, "behaviour", of_vtypes[vtype], layout.attributes) for vtype in layout.vtypes}
    behaviour = [value for group in layout.vtype_groups for value in of_vtype[group[0]]]
    _check_followers(file, of_vtype, behaviour, layout)
    return CalibratedRun((*demand, *behaviour), _first_seed(result), _changes(run, problem))


def _check_followers(
    file: Path, of_vtype: Mapping[str, Sequence[float]], behaviour: Sequence[float], layout: ParameterLayout
) -> None:
    """Refuse a result whose vTypes moved otherwise than the case says: no parameter vector means its values."""
    for group in layout.vtype_groups:
        for vtype in group[1:]:
            meant = list(layout.values_of(vtype, behaviour).values())
            if not np.allclose(of_vtype[vtype], meant, rtol=SAME, atol=SAME):
                expected = (
                    f"expected values that follow from those of {quote(group[0])} as behaviour.common and "
                    "behaviour.apart of the case say; is this a result of another?"
                )
                raise CaseError(file, f"parameters.behaviour.{vtype}", expected)


def _numbers(file: Path, part: str, table: Any, names: tuple[str, ...]) -> tuple[float, ...]:
    if not isinstance(table, dict) or set(table) != set(names):
        raise CaseError(
            file, f"parameters.{part}", f"expected those of the case, {', '.join(names)}; is this a result of another?"
        )
    for name in names:
        value = table[name]
        if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
            raise CaseError(file, f"parameters.{part}.{name}", f"expected a number, got {quote(value)}.")
    return tuple(float(table[name]) for name in names)


def _first_seed(result: dict[str, Any]) -> int:
    seeds = result.get("seeds")
    seed = seeds.get("search", 0) if isinstance(seeds, dict) else 0
    return int(seed) if isinstance(seed, int) else 0


def _changes(run: Path, problem: CalibrationProblem) -> tuple[str, ...]:
    """Say how the case differs from the one that was calibrated: other drives are a fair test, but must be known."""
    file = run / IDENTITY_FILE
    try:
        begun = json.loads(file.read_text(encoding="utf-8"))["case"]
    except (OSError, ValueError, KeyError, TypeError):
        return (f"{run.name}/{IDENTITY_FILE} cannot be read; whether the case is the one calibrated is not known.",)
    if begun == identify(problem.case, {})["case"]:
        return ()
    return ("The case's files are not those that the calibration saw; drives to fit may be others now.",)
