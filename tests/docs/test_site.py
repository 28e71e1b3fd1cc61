"""The docs as far as a program can judge them: they build, links lead somewhere, files that they name exist."""

import importlib.util
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from jaxcalib.problem.parameter_space import ranges_of
from sim_adapters.scenario.sumo_names import SUMO_MODELS
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS
from tests.places import ROOT

PAGES = sorted((ROOT / "docs").glob("*.md"))
TOP = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
MOST_WORDS = 16_000
LINK = re.compile(r"\]\(([^)\s]+)\)")
SOURCE_FILE = re.compile(r"`((?:surrogate|sim_adapters|jaxcalib|experiments|tests|docs)/[\w./]+)`")


def anchors(page: Path) -> set[str]:
    """Return what links may name: headings as sites write them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    for module in ("sphinx", "myst_parser", "furo"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for page in PAGES:
        assert (tmp_path / "site" / f"{page.stem}.html").is_file()


@pytest.mark.parametrize("page", [*TOP, *PAGES], ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor:
            assert anchor in anchors(file), f"{page.name}: {target}"


@pytest.mark.parametrize("page", [*TOP[:2], *PAGES], ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page: Path) -> None:
    if page.name == "effects.md":  # its example is a file that the reader writes
        text = page.read_text(encoding="utf-8").replace("`surrogate/effects/sun_glare.py`", "")
    else:
        text = page.read_text(encoding="utf-8")
    for name in SOURCE_FILE.findall(text):
        assert (ROOT / name).exists(), f"{page.name}: {name}"


def script(name: str) -> ModuleType:
    """Return a script of the docs as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_picture_of_the_architecture_is_that_of_the_contracts() -> None:
    module = script("draw_floors")
    assert module.PICTURE.read_text(encoding="utf-8") == module.drawing(), "python docs/draw_floors.py"


def test_the_page_of_parameters_is_completed_with_all_that_may_be_searched_or_fitted() -> None:
    module = script("parameter_tables")
    text = module.completed(module.PAGE.read_text(encoding="utf-8"))
    assert "<!--" not in text
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| `")]
    for model in SUMO_MODELS:
        named = {row[0].strip("| `") for row in rows if model in re.split(r" \*|, ", row[1]) or row[1] == "all *"}
        assert named >= set(ranges_of(model))
    for entry in CAR_FOLLOWING_MODELS:
        named = {row[0].strip("| `") for row in rows if len(row) == 5 and entry.name in row[1].split(", ")}
        assert named == {row.name for row in entry.parameters}
        assert entry.source in text


def test_the_version_has_a_dated_heading_in_the_changelog() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d{{2}}-\d{{2}}$", changelog, flags=re.MULTILINE)


def test_a_reader_is_not_asked_to_read_a_book() -> None:
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in PAGES) <= MOST_WORDS
