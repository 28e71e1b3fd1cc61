"""The generator shares no code with the diagnosis: what it imports, and what those import."""

import ast
from pathlib import Path

import pytest

from experiments.blind_effects.effects import EFFECTS
from tests.places import ROOT

FOLDER = ROOT / "experiments" / "blind_effects"
FORBIDDEN = {"jaxcalib", "sim_adapters", "surrogate", "jax", "equinox"}
DRIVING = (
    "setSpeed",
    "setAccel",
    "moveTo",
    "slowDown",
    "changeLane",
    "setTau",
    "setParameter",
    "setMaxSpeed",
    "setStop",
)
MODULES = sorted([*FOLDER.glob("*.py"), *(ROOT / "experiments" / "roads").glob("*.py")])
OWN = ("experiments.blind_effects", "experiments.roads")


def imported(tree: ast.AST) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports would hide where they lead"
            names.add(str(node.module))
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
            "__import__",
            "import_module",
        ):
            raise AssertionError("an import by name cannot be checked")
    return names


@pytest.mark.parametrize("module", MODULES, ids=lambda file: file.stem)
def test_no_module_imports_the_program_or_another_study(module: Path):
    for name in imported(ast.parse(module.read_text(encoding="utf-8"))):
        assert name.split(".")[0] not in FORBIDDEN
        assert not name.startswith("experiments") or name.startswith(OWN)


@pytest.mark.parametrize("module", MODULES, ids=lambda file: file.stem)
def test_no_module_drives_vehicles(module: Path):
    tree = ast.parse(module.read_text(encoding="utf-8"))
    called = {node.func.attr for node in ast.walk(tree) if isinstance(node, ast.Call) and hasattr(node.func, "attr")}
    assert not {name for name in called if name.startswith(DRIVING)}


def test_names_are_the_library_s():
    from jaxcalib.cli.effect_list import EFFECTS as LIBRARY

    inside = {name for name, effect in EFFECTS.items() if not effect.is_outside}
    outside = set(EFFECTS) - inside
    known = {effect.name for effect in LIBRARY}
    assert inside <= known
    assert not outside & known
    assert known - inside == {"multi_anticipation", "lane_change_relaxation", "grade"}
