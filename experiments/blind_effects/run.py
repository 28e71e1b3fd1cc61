"""Has cases diagnosed, one after the other, by a command that knows nothing of their labels."""

import json
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from experiments.blind_effects.seal import file_hash

ANSWER = "diagnosis.json"


def case_folders(cases: Path) -> list[Path]:
    """Return the cases in a folder, those of its `cases` and `twins` if there are such.

    Raises:
        FileNotFoundError: there are none.
    """
    inside = [cases / name for name in ("cases", "twins") if (cases / name).is_dir()] or [cases]
    folders = [file.parent for parent in inside for file in sorted(parent.glob("*/case.toml"))]
    if not folders:
        raise FileNotFoundError(f"{cases}: expected folders with case.toml.")
    return folders


def run_name(case: Path) -> str:
    """Return the name of the answer's folder."""
    return f"{case.name}_twin" if case.parent.name == "twins" else case.name


def diagnose_cases(cases: Path, runs: Path, program: str, options: Sequence[str]) -> int:
    """Diagnose those without an answer, record the answers' hashes, and return how many failed."""
    runs.mkdir(parents=True, exist_ok=True)
    failed = 0
    folders = case_folders(cases)
    with Progress() as progress:
        task = progress.add_task("cases", total=len(folders))
        for case in folders:
            folder = runs / run_name(case)
            if not (folder / ANSWER).is_file():
                failed += not _diagnose(case, folder, program, options)
                answers = {file.parent.name: file_hash(file) for file in sorted(runs.glob(f"*/{ANSWER}"))}
                (runs / "answers.json").write_text(json.dumps(answers, indent=1), encoding="utf-8")
            progress.advance(task)
    return failed


def _diagnose(case: Path, folder: Path, program: str, options: Sequence[str]) -> bool:
    resume = ["--resume"] if folder.exists() else []
    command = [program, "diagnose", str(case), "--out", str(folder), *resume, *options]
    began_s = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0 and (folder / ANSWER).is_file():
        (folder / "command_wall_s.txt").write_text(f"{time.monotonic() - began_s:.1f}\n", encoding="utf-8")
        return True
    lines = (done.stderr.strip() or done.stdout.strip() or "no output").splitlines()
    print(f"{case.name}: exit code {done.returncode}: {lines[-1]}")
    return False
