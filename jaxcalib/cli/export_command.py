"""`jaxcalib export` as a person meets it: messages and exit codes."""

from pathlib import Path

from jaxcalib.cli.guarded import guarded
from jaxcalib.exporters.export import Format, export


def run_export(
    case: Path,
    run: Path,
    out: Path,
    to: Format,
    drive: str | None,
    seed: int,
    range_m: float | None,
    *,
    free_subject: bool,
    quiet: bool,
) -> int:
    """Export and return the exit code."""

    def work() -> str:
        said = export(case, run, out, to=to, drive=drive, seed=seed, range_m=range_m, free_subject=free_subject)
        return "" if quiet else "\n".join(said)

    return guarded(work, "the same command begins anew", out)
