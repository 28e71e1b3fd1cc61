"""`jaxcalib validate` as a person meets it: messages and exit codes."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from jaxcalib.cli.guarded import guarded, to_go_on
from jaxcalib.cli.profile_table import print_profile
from jaxcalib.cli.terminal import TerminalProgress
from jaxcalib.runs.profile import profiled
from jaxcalib.runs.progress import Silent
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
    margins: Path | None
    half_step: bool
    resume: bool
    cluster: str | None
    profile: bool
    quiet: bool


def run_validation(options: ValidateOptions) -> int:
    """Validate and return the exit code."""
    folder = options.out or options.run / FOLDER

    def work() -> str:
        with profiled(options.profile), Silent() if options.quiet else TerminalProgress() as progress:
            result = validate(
                options.case, options.run, options.out, seeds=options.seeds, drives=options.drives,
                counts=options.counts, margins=options.margins, half_step=options.half_step, resume=options.resume,
                cluster=options.cluster, progress=progress,
            )  # fmt: skip
            print_profile()
        return "" if options.quiet else _summary(result, folder)

    return guarded(work, to_go_on("--resume"), folder)


def _summary(result: ValidationResult, folder: Path) -> str:
    lines = [""]
    for one in result.criteria:
        if one.passes is None:
            lines.append(f"  -     {one.name}: not testable, {one.note}")
            continue
        bound = f"{'at most' if one.is_upper else 'at least'} {one.limit:.4g}"
        lines.append(f"  {'pass' if one.passes else 'FAIL'}  {one.name}: {one.value:.4g} ({bound}; {one.standard})")
    said = Counter(one["verdict"] for one in result.equivalence.values())
    lines += ["", "within the margins: " + ", ".join(f"{number} {words}" for words, number in said.most_common())]
    if result.step_error is not None:
        said = Counter(one["verdict"] for one in result.step_error["quantities"].values())
        lines.append("with half the step: " + ", ".join(f"{number} {words}" for words, number in said.most_common()))
    verdict = "valid" if result.is_valid else "not valid"
    lines += ["", f"{verdict}, by {result.num_rounds} rounds of {len(result.drives)} {result.role} drives"]
    lines += [*(f"warning: {line}" for line in result.warnings), f"report: {folder / 'validation.html'}"]
    return "\n".join(lines)
