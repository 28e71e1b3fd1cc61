"""Calibrates SUMO traffic around automated vehicles from the logs that such a vehicle recorded.

import jaxcalib
result = jaxcalib.calibrate("CASE", "RUN")
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxcalib.calibration.pipeline import calibrate
    from jaxcalib.calibration.result.result import CalibrationResult
    from jaxcalib.diagnosis.answer.answer import Diagnosis
    from jaxcalib.diagnosis.run import diagnose
    from jaxcalib.dossier.dossier import Dossier, write_dossier
    from jaxcalib.errors import CaseError
    from jaxcalib.sweeps.sweep import SweepResult, sweep
    from jaxcalib.validation.result import ValidationResult
    from jaxcalib.validation.validate import validate

__all__ = [
    "CalibrationResult",
    "CaseError",
    "Diagnosis",
    "Dossier",
    "SweepResult",
    "ValidationResult",
    "calibrate",
    "diagnose",
    "sweep",
    "validate",
    "write_dossier",
]

_HOME = {
    "CalibrationResult": "jaxcalib.calibration.result.result",
    "CaseError": "jaxcalib.errors",
    "Diagnosis": "jaxcalib.diagnosis.answer.answer",
    "Dossier": "jaxcalib.dossier.dossier",
    "SweepResult": "jaxcalib.sweeps.sweep",
    "ValidationResult": "jaxcalib.validation.result",
    "calibrate": "jaxcalib.calibration.pipeline",
    "diagnose": "jaxcalib.diagnosis.run",
    "sweep": "jaxcalib.sweeps.sweep",
    "validate": "jaxcalib.validation.validate",
    "write_dossier": "jaxcalib.dossier.dossier",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is asked for: JAX takes seconds to load, `--help` should not."""
    if name not in _HOME:
        raise AttributeError(f"module 'jaxcalib' has no attribute '{name}'")
    from importlib import import_module

    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value
