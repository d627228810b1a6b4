"""Laws of the code hash: what a module imports counts, what it does not import does not."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.shards.code_hash import CONTENT, PLUMBING, ROOT, function_code, hash_code, module_closure

FILES = {
    "stages/__init__.py": "",
    "stages/drop.py": "from pipeline.physics import fall\nimport pipeline.shards.store\n",
    "pipeline/__init__.py": '"""Nothing."""\n',
    "pipeline/physics/__init__.py": "",
    "pipeline/physics/fall.py": (
        "from typing import TYPE_CHECKING\n"
        "from . import gravity\n"
        "from .air import drag as slow\n"
        "if TYPE_CHECKING:\n    import pipeline.unrelated\n"
        "def fall():\n    import pipeline.scene.late\n    return 1\n"
    ),
    "pipeline/physics/gravity.py": "import numpy\ng = 9.81  # m/s²\n",
    "pipeline/physics/air.py": '"""Air."""\nfrom ..scene import text\ndef drag(v):\n    """Slows."""\n    return -v\n',
    "pipeline/scene/text.py": "import importlib\nimportlib.import_module('pipeline.scene.dynamic')\n",
    "pipeline/scene/late.py": "",
    "pipeline/scene/dynamic.py": "",
    "pipeline/unrelated.py": "",
    "pipeline/shards/store.py": "import pipeline.unrelated\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def hash_of(root: Path) -> str:
    return hash_code(module_closure(root / "stages/drop.py", root), root)


def test_the_closure_has_every_import_and_no_plumbing(root: Path) -> None:
    closure = {path.relative_to(root).as_posix() for path in module_closure(root / "stages/drop.py", root)}
    assert closure == set(FILES) - {"stages/__init__.py", "pipeline/unrelated.py", "pipeline/shards/store.py"}


def test_a_module_that_imports_itself_in_a_circle_is_walked_once(root: Path) -> None:
    (root / "pipeline/physics/gravity.py").write_text("from pipeline.physics import fall\n")
    assert root / "pipeline/physics/fall.py" in module_closure(root / "stages/drop.py", root)


@pytest.mark.parametrize("name", ["stages/drop.py", "pipeline/physics/air.py", "pipeline/scene/dynamic.py"])
def test_a_change_of_what_is_imported_however_indirectly_changes_the_hash(root: Path, name: str) -> None:
    before = hash_of(root)
    with open(root / name, "a") as file:
        file.write("x = 1\n")
    assert hash_of(root) != before


@pytest.mark.parametrize(
    "change",
    [
        lambda root: (root / "pipeline/unrelated.py").write_text("x = 1\n"),
        lambda root: (root / "pipeline/shards/store.py").write_text("x = 1\n"),
        lambda root: (root / "pipeline/physics/gravity.py").write_text('"""Gravity."""\nimport numpy\ng = 9.81\n'),
        lambda root: (root / "pipeline/physics/air.py").write_text(
            FILES["pipeline/physics/air.py"].replace("Slow", "")
        ),
    ],
    ids=["unrelated", "plumbing", "comment", "docstring"],
)
def test_what_cannot_change_a_result_does_not_change_the_hash(root: Path, change: Callable[[Path], object]) -> None:
    before = hash_of(root)
    change(root)
    assert hash_of(root) == before


def test_the_same_code_elsewhere_has_the_same_hash(root: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = tmp_path_factory.mktemp("other")
    for name, text in FILES.items():
        (other / name).parent.mkdir(parents=True, exist_ok=True)
        (other / name).write_text(text)
    assert hash_of(other) == hash_of(root)


def test_a_function_s_code_is_its_module_and_what_decides_the_bytes_of_shards(tmp_path: Path) -> None:
    def load(text: str) -> Callable[[], float]:
        file = tmp_path / "toy_of_code_hash.py"
        file.write_text(text)
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatched.setitem(__import__("sys").modules, file.stem, module)
        spec.loader.exec_module(module)
        return module.compute

    with pytest.MonkeyPatch.context() as monkeypatched:
        alone = function_code(load("def compute():\n    return 1\n"))
        assert function_code(load("def compute():\n    return 1  # again\n")) == alone
        assert function_code(load("def compute():\n    return 2\n")) != alone
    for name in CONTENT:
        assert (ROOT / name.replace(".", "/")).with_suffix(".py").is_file()


def test_plumbing_is_there() -> None:
    for name in PLUMBING:
        path = ROOT / name.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file()


GRAPH_PLUMBING = {name.rpartition(".")[2] for name in PLUMBING if name.startswith("stages.graph.")}


def test_of_stages_graph_only_the_parameters_and_how_a_stage_runs_are_plumbing() -> None:
    assert {"lock_copy", "params", "params_file", "run", "stage_params"} == GRAPH_PLUMBING


@pytest.mark.parametrize("stage", sorted(path.stem for path in (ROOT / "stages").glob("[!_]*.py")))
def test_the_code_of_a_stage_is_all_that_it_imports_of_stages_graph_but_the_plumbing(stage: str) -> None:
    file, graph = ROOT / "stages" / f"{stage}.py", ROOT / "stages/graph"
    closure = {path.stem for path in module_closure(file) if path.parent == graph}
    imported = {path.stem for path in module_closure(file, without=()) if path.parent == graph}
    assert closure == imported - GRAPH_PLUMBING


def test_a_stage_that_starts_from_answers_has_in_its_key_how_they_are_read() -> None:
    closure = {path.name for path in module_closure(ROOT / "stages/fit.py")}
    assert {"search_target.py", "found_row.py"} <= closure
    closure = {path.name for path in module_closure(ROOT / "stages/infer.py")}
    assert {"answering_model.py", "clip_pictures.py", "examples.py"} <= closure
