"""`jaxcalib validate` as a person meets it: messages and exit codes."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from jaxcalib.calibration.evaluator import AllRunsFailedError
from jaxcalib.cli import EXIT_CASE_WRONG, EXIT_RESOURCE, EXIT_SIMULATOR_FAILED, EXIT_STOPPED
from jaxcalib.errors import CaseError, ResourceError, shorten
from jaxcalib.progress import Silent
from jaxcalib.terminal import TerminalProgress
from jaxcalib.validation.result import ValidationResult
from jaxcalib.validation.validate import FOLDER, validate


@dataclass(frozen=True)
class ValidateOptions:
    """What stands on the command line."""

    case: Path
    run: Path
    out: Path | None
    seeds: int
    drives: Literal["held_out", "fit"] | None
    counts: Path | None
    resume: bool
    quiet: bool


def run_validation(options: ValidateOptions) -> int:
    """Validate and return the exit code."""
    progress = Silent() if options.quiet else TerminalProgress()
    folder = options.out or options.run / FOLDER
    try:
        with progress:
            result = validate(
                options.case, options.run, options.out, seeds=options.seeds, drives=options.drives,
                counts=options.counts, resume=options.resume, progress=progress,
            )  # fmt: skip
    except CaseError as error:
        print(f"jaxcalib: {error}", file=sys.stderr)
        return EXIT_CASE_WRONG
    except ResourceError as error:
        print(f"jaxcalib: {error}", file=sys.stderr)
        return EXIT_RESOURCE
    except AllRunsFailedError as error:
        print(f"jaxcalib: {shorten(str(error), 250)}. {shorten(error.log_tail)}", file=sys.stderr)
        return EXIT_SIMULATOR_FAILED
    except KeyboardInterrupt:
        again = f"jaxcalib validate {options.case} {options.run} --seeds {options.seeds} --resume"
        print(f"jaxcalib: stopped; go on with: {again}", file=sys.stderr)
        return EXIT_STOPPED
    if not options.quiet:
        print(_summary(result, folder))
    return 0


def _summary(result: ValidationResult, folder: Path) -> str:
    lines = [""]
    for one in result.criteria:
        if one.passes is None:
            lines.append(f"  -     {one.name}: not testable, {one.note}")
            continue
        bound = f"{'at most' if one.is_upper else 'at least'} {one.limit:.4g}"
        lines.append(f"  {'pass' if one.passes else 'FAIL'}  {one.name}: {one.value:.4g} ({bound}; {one.standard})")
    verdict = "valid" if result.is_valid else "not valid"
    lines += ["", f"{verdict}, by {result.num_rounds} rounds of {len(result.drives)} {result.role} drives"]
    lines += [*(f"warning: {line}" for line in result.warnings), f"report: {folder / 'validation.html'}"]
    return "\n".join(lines)
