"""Where results come from: versions of program and libraries, and the commit of the program."""

import functools
import subprocess
from importlib import metadata
from pathlib import Path

from jaxcalib.runs.run_folder import LIBRARIES


def versions(*more: str) -> dict[str, str]:
    """Return the version of the program and of the libraries that runs depend on."""
    return {name: metadata.version(name) for name in ("jaxcalib", *LIBRARIES, *more)}


@functools.cache
def commit() -> str | None:
    """Return the commit of the program, with "-changed" where files differ from it; None outside of a repository."""
    try:
        head = _git("rev-parse", "HEAD").strip()
        return f"{head}-changed" if _git("status", "--porcelain", "--untracked-files=no").strip() else head
    except (OSError, subprocess.SubprocessError):
        return None


def _git(*arguments: str) -> str:
    folder = Path(__file__).parents[1]
    _refuse_foreign(folder)
    return subprocess.run(
        ["git", "-C", str(folder), *arguments], capture_output=True, text=True, timeout=10, check=True
    ).stdout


def _refuse_foreign(folder: Path) -> None:
    """An installed program may lie in somebody else's repository, below a virtual environment."""
    if not (folder.parent / ".git").exists():
        raise FileNotFoundError("not a clone of the program")
