"""Imports inside the discovery go one way: discover -> report -> selection -> where -> fitting -> tracks -> tables."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "pipeline" / "discovery"
LAYERS = ("tables", "tracks", "fitting", "where", "selection", "report")
ON_TOP = {"filmed", "mechanisms"}  # other ways in, which the layers do not know


def imported_modules(path: Path) -> set[str]:
    """Every module that a file imports, also inside functions and for type checking."""
    out: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None, path
            out.add(node.module)
    return out


def layer_of(module: str) -> int | None:
    parts = module.split(".")
    if parts[:2] != ["pipeline", "discovery"]:
        return None
    return LAYERS.index(parts[2]) if len(parts) > 2 and parts[2] in LAYERS else len(LAYERS)


def test_the_sub_packages_are_the_layers() -> None:
    assert {p.parent.name for p in FOLDER.glob("*/__init__.py")} == {*LAYERS, *ON_TOP}


@pytest.mark.parametrize("name", LAYERS)
def test_no_module_imports_from_a_layer_above(name: str) -> None:
    for path in (FOLDER / name).glob("*.py"):
        layers = {layer_of(module) for module in imported_modules(path)} - {None}
        assert all(layer is not None and layer <= LAYERS.index(name) for layer in layers), path


@pytest.mark.parametrize("name", LAYERS)
def test_the_modules_of_a_layer_import_each_other_in_no_circle(name: str) -> None:
    prefix = f"pipeline.discovery.{name}."
    waiting = {
        path.stem: {m.removeprefix(prefix) for m in imported_modules(path) if m.startswith(prefix)}
        for path in (FOLDER / name).glob("*.py")
    }
    while waiting:
        free = {module for module, needs in waiting.items() if not needs & set(waiting)}
        assert free, f"a circle among {sorted(waiting)}"
        waiting = {module: needs for module, needs in waiting.items() if module not in free}


def test_effects_import_neither_the_discovery_nor_hidden_worlds() -> None:
    for path in (ROOT / "pipeline" / "scene" / "effects").rglob("*.py"):
        modules = imported_modules(path)
        assert not [m for m in modules if m.startswith(("pipeline.discovery", "pipeline.hidden"))], path
