"""`python -m experiments.results`: make the Markdown of every study from its JSON; `--check` only compares."""

import sys

from cyclopts import App

from experiments.results.markdown import markdown
from experiments.results.record import FOLDER, read_study, write_study

app = App(name="experiments.results", help="Tables of what was measured, from the JSON files.")


@app.default
def render(*, check: bool = False) -> int:
    """Write every page anew.

    Parameters
    ----------
    check
        Write nothing; end with 1 if a page is not what its JSON makes.
    """
    stale = []
    for path in sorted(FOLDER.glob("*.json")):
        study, page = read_study(path), path.with_suffix(".md")
        if not page.is_file() or page.read_text(encoding="utf-8") != markdown(study):
            stale.append(page.name)
            if not check:
                write_study(path, study)
    print(f"{'differ' if check else 'written'}: {', '.join(stale) or 'none'}", file=sys.stderr)
    return int(check and bool(stale))


if __name__ == "__main__":
    sys.exit(app())
