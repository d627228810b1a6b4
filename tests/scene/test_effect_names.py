"""Effects are named in their own modules alone, so that a new effect is one file."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.scene.effects.registry import effect_kinds

ROOT = Path(__file__).resolve().parents[2]
KINDS = ROOT / "pipeline" / "scene" / "effects" / "kinds"
OF_MECHANISMS = ROOT / "pipeline" / "discovery" / "mechanisms" / "kinds"
"""Some laws act on free bodies and on mechanisms; each has a module of the same name in both folders."""
REPORT_KEYS = {(ROOT / "pipeline" / "discovery" / "report" / "report_dict.py", "restitution")}
"""Keys of report.json that are field terms and effect names by chance."""


def modules() -> Iterator[tuple[Path, ast.Module]]:
    for folder in ("pipeline", "stages"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not (path.is_relative_to(KINDS) or path.is_relative_to(OF_MECHANISMS)):
                yield path, ast.parse(path.read_text(encoding="utf-8"))


def test_no_string_elsewhere_is_an_effect_name_or_a_list_of_them() -> None:
    names, found = set(effect_kinds()), []
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                words = [word for word in re.split(r"\W+", node.value) if word]
                if words and set(words) <= names and (path, node.value) not in REPORT_KEYS:
                    found.append((path.relative_to(ROOT).as_posix(), node.lineno, node.value))
    assert not found


def test_no_module_elsewhere_imports_an_effect() -> None:
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                assert not node.module.startswith("pipeline.scene.effects.kinds"), path


def test_each_effect_is_named_as_its_module() -> None:
    assert {path.stem for path in KINDS.glob("*.py")} - {"__init__"} == set(effect_kinds())
    assert {path.stem for path in OF_MECHANISMS.glob("*.py")} - {"__init__"} == set(mechanism_effects())
