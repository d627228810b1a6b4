"""dvc.yaml agrees with the code: each stage's `deps` are the code that it imports, its `params` those it reads."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pipeline.shards.code_hash import PACKAGES, PLUMBING, ROOT, module_closure
from stages.graph.stage_params import READS, declared_keys

_COMMAND = re.compile(r"-m\s+((?:stages|training)\.[\w.]+)([^&|;\n]*)")


@dataclass(frozen=True)
class DvcStage:
    """One stage as DVC resolves it, one for each item of a matrix."""

    address: str
    module: str
    words: tuple[str, ...]
    deps: tuple[str, ...]
    params: frozenset[str]

    @property
    def name(self) -> str:
        return self.module.rpartition(".")[2]

    @property
    def suite(self) -> str | None:
        return self.words[0] if self.words else None


def stages_of(root: Path) -> list[DvcStage]:
    """The stages of root/dvc.yaml that run one of our modules, with matrices and templates resolved by DVC."""
    from dvc.repo import Repo

    stages = []
    with Repo(str(root)) as repo:
        for stage in repo.index.stages:
            commands = [stage.cmd] if isinstance(stage.cmd, str) else stage.cmd or []
            for module, words in (match.groups() for command in commands for match in _COMMAND.finditer(command)):
                files = tuple(dep.def_path for dep in stage.deps if not hasattr(dep, "params"))
                params = frozenset(key for dep in stage.deps for key in getattr(dep, "params", None) or ())
                stages.append(DvcStage(stage.name, module, tuple(words.split()), files, params))
    return stages


def missing_deps(stage: DvcStage, root: Path) -> list[str]:
    """The files that the stage imports and none of its deps covers; plumbing and empty modules need none."""
    covered = tuple(root / dep for dep in stage.deps)
    closure = module_closure(module_file(stage, root), root)
    uncovered = (path for path in closure if has_code(path) and not any(path.is_relative_to(dep) for dep in covered))
    return sorted(path.relative_to(root).as_posix() for path in uncovered)


def has_code(file: Path) -> bool:
    """Whether a module has more than a docstring and comments."""
    body = ast.parse(file.read_text(encoding="utf-8")).body
    return any(not isinstance(part, ast.Expr) for part in body)


def unneeded_deps(stage: DvcStage, root: Path) -> list[str]:
    """The deps on our code, and the folders in them, of which the stage imports nothing."""
    closure = module_closure(module_file(stage, root), root)
    plumbing = tuple(root / name.replace(".", "/") for name in PLUMBING)
    unneeded = []
    for dep in stage.deps:
        if dep.split("/")[0] not in PACKAGES:
            continue
        for place in (root / dep, *folders_with_code(root / dep)):
            if not any(path.is_relative_to(place) for path in closure) and place.with_suffix("") not in plumbing:
                unneeded.append(place.relative_to(root).as_posix())
    return sorted(set(unneeded))


def folders_with_code(path: Path) -> Iterator[Path]:
    return (folder for folder in path.rglob("*") if folder.is_dir() and any(folder.glob("*.py")))


def module_file(stage: DvcStage, root: Path) -> Path:
    return root.joinpath(*stage.module.split(".")).with_suffix(".py")


# ---- the project's own graph


@pytest.fixture(scope="module")
def graph() -> list[DvcStage]:
    return stages_of(ROOT)


def test_every_stage_runs_a_module_that_is_there(graph: list[DvcStage]) -> None:
    assert graph
    for stage in graph:
        assert module_file(stage, ROOT).is_file(), stage.address


def test_every_import_of_a_stage_is_covered_by_its_deps(graph: list[DvcStage]) -> None:
    assert {stage.address: missing for stage in graph if (missing := missing_deps(stage, ROOT))} == {}


def test_no_stage_depends_on_code_that_it_does_not_import(graph: list[DvcStage]) -> None:
    assert {stage.address: unneeded for stage in graph if (unneeded := unneeded_deps(stage, ROOT))} == {}


def test_the_params_of_a_stage_are_those_that_its_loader_declares(graph: list[DvcStage]) -> None:
    for stage in graph:
        declared = frozenset(declared_keys(stage.name, stage.suite)) if stage.name in READS else frozenset()
        assert stage.params == declared, stage.address


def test_every_stage_that_declares_params_is_in_the_graph(graph: list[DvcStage]) -> None:
    assert set(READS) <= {stage.name for stage in graph}


def test_what_python_leaves_in_the_folders_of_deps_is_ignored(graph: list[DvcStage]) -> None:
    from dvc.repo import Repo

    with Repo(str(ROOT)) as repo:
        assert repo.dvcignore.is_ignored_dir(str(ROOT / "pipeline" / "scene" / "__pycache__"))


# ---- the checks themselves, on a graph that is wrong in every way

TOY = {
    "stages/sample.py": "from pipeline.scene import draw\nfrom pipeline.shards import map_shards\n",
    "pipeline/__init__.py": '"""Nothing."""\n',
    "pipeline/scene/draw.py": "import pipeline.physics.fall\n",
    "pipeline/scene/more/noise.py": "x = 1\n",
    "pipeline/physics/fall.py": "g = 9.81\n",
    "pipeline/vision/see.py": "y = 1\n",
    "pipeline/shards/map_shards.py": "z = 1\n",
    "params.yaml": "seed: 1\nsample: {suites: {train: {clips: 2}, val: {clips: 1}}}\n",
}

DVC_YAML = """\
stages:
  sample:
    matrix: {{suite: [train, val]}}
    cmd: python -m stages.sample ${{item.suite}}
    deps: {deps}
    params: [seed, "sample.suites.${{item.suite}}"]
    outs: ["data/sample/${{item.suite}}"]
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    for name, text in TOY.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run([sys.executable, "-m", "dvc", "init", "--no-scm", "-q"], cwd=tmp_path, check=True)
    return tmp_path


def toy_stages(root: Path, *deps: str) -> list[DvcStage]:
    (root / "dvc.yaml").write_text(DVC_YAML.format(deps=list(deps)))
    return stages_of(root)


def test_a_matrix_is_resolved(toy: Path) -> None:
    train, val = toy_stages(toy, "stages/sample.py")
    assert (train.address, train.name, train.suite) == ("sample@train", "sample", "train")
    assert train.params == {"seed", "sample.suites.train"}
    assert val.params == {"seed", "sample.suites.val"}


@pytest.mark.parametrize(
    ("deps", "missing", "unneeded"),
    [
        (["stages/sample.py", "pipeline/scene/draw.py", "pipeline/physics"], [], []),
        (["stages/sample.py", "pipeline/scene/draw.py"], ["pipeline/physics/fall.py"], []),
        (["pipeline/scene/draw.py", "pipeline/physics"], ["stages/sample.py"], []),
        (["stages/sample.py", "pipeline/scene", "pipeline/physics"], [], ["pipeline/scene/more"]),
        (["stages", "pipeline"], [], ["pipeline/scene/more", "pipeline/vision"]),
        (
            ["stages", "pipeline/scene/draw.py", "pipeline/physics", "pipeline/shards", "pipeline/vision/see.py"],
            [],
            ["pipeline/vision/see.py"],
        ),
    ],
)
def test_deps_that_are_too_few_or_too_many_are_noticed(
    toy: Path, deps: list[str], missing: list[str], unneeded: list[str]
) -> None:
    for stage in toy_stages(toy, *deps):
        assert missing_deps(stage, toy) == missing
        assert unneeded_deps(stage, toy) == unneeded
