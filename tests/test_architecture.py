"""How the packages may import each other, read from the source: imports in functions and under TYPE_CHECKING count."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TOP = ("pipeline", "stages", "training", "benchmarks")
Graph = dict[str, dict[str, list[str]]]
MOST_NUMBERS = 1473
"""Numbers in `pipeline` that are set by hand. One more is a decision between hypotheses that evidence should make; at
most 700 are the goal. A change that removes some lowers this limit."""


def package_of(module: str) -> str:
    """`pipeline.scene` for pipeline.scene.effects.kind; below the other packages nothing is told apart."""
    return ".".join(module.split(".")[: 2 if module.startswith("pipeline.") else 1])


def imported_modules(file: Path, root: Path) -> Iterator[str]:
    """The modules that a file imports, as full names; `from a import b` gives a.b where that is a module."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = file.relative_to(root).with_suffix("").parts[: -node.level] if node.level else ()
            module = ".".join([*above, *([node.module] if node.module else [])])
            for name in (f"{module}.{alias.name}" for alias in node.names):
                path = root.joinpath(*name.split("."))
                yield name if path.is_dir() or path.with_suffix(".py").is_file() else module


def import_graph(root: Path) -> Graph:
    """Package -> package or library that it imports -> the files that do."""
    graph: Graph = defaultdict(lambda: defaultdict(list))
    for file in (file for top in TOP for file in sorted((root / top).rglob("*.py"))):
        own = package_of(".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__"))
        for module in imported_modules(file, root):
            other = package_of(module)
            if other != own:
                graph[own][other].append(file.relative_to(root).as_posix())
    return graph


def circle(graph: Graph) -> list[str]:
    """Packages of `pipeline` that import each other in a circle, and the files that close it; empty for none."""
    inner = {a: [b for b in others if b.startswith("pipeline.")] for a, others in graph.items() if "." in a}
    try:
        TopologicalSorter(inner).prepare()
    except CycleError as error:
        around = error.args[1][::-1]
        return [f"{a} imports {b} in {graph[a][b]}" for a, b in pairwise(around)]
    return []


def file_circle(root: Path) -> list[str]:
    """Files of `pipeline` that import each other in a circle; empty for none. Imports of a package do not count."""
    inner = {}
    for file in sorted((root / "pipeline").rglob("*.py")):
        paths = {root.joinpath(*module.split(".")).with_suffix(".py") for module in imported_modules(file, root)}
        inner[file] = [path for path in paths if path != file and path.is_file()]
    try:
        TopologicalSorter(inner).prepare()
    except CycleError as error:
        return [path.relative_to(root).as_posix() for path in error.args[1][::-1]]
    return []


def number_of(node: ast.AST | None) -> float | None:
    """The number that a node states; None for other nodes."""
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def is_chosen(node: ast.AST | None) -> bool:
    """Whether it is a number that somebody chose: any but 0, 1 and 2."""
    return number_of(node) not in (None, 0, 1, 2)


def hand_set_numbers(root: Path) -> Iterator[str]:
    """Where the pipeline has numbers set by hand: constants of modules, defaults, fields, and what is compared with."""
    for file in sorted((root / "pipeline").rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        found: list[ast.AST | None] = []
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.Lambda):
                found += filter(is_chosen, [*node.args.defaults, *node.args.kw_defaults])
            elif isinstance(node, ast.ClassDef):
                found += [b for b in node.body if isinstance(b, ast.AnnAssign) and is_chosen(b.value)]
            elif isinstance(node, ast.Compare):
                found += [n for side in (node.left, *node.comparators) for n in ast.walk(side) if is_chosen(n)]
        for line in (line for line in tree.body if isinstance(line, ast.Assign | ast.AnnAssign)):
            names = [n.id for n in ast.walk(line) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
            if names and names[0].isupper() and any(number_of(n) is not None for n in ast.walk(line)):
                found.append(line)
        yield from (f"{file.relative_to(root)}:{getattr(node, 'lineno', 0)}" for node in found)


@pytest.fixture(scope="module")
def graph() -> Graph:
    return import_graph(ROOT)


def test_no_file_of_the_pipeline_imports_another_in_a_circle() -> None:
    assert file_circle(ROOT) == []


def test_no_package_of_the_pipeline_imports_another_in_a_circle(graph: Graph) -> None:
    assert circle(graph) == []


@pytest.mark.parametrize("outer", ["stages", "training", "benchmarks"])
def test_the_pipeline_imports_nothing_that_is_built_on_it(graph: Graph, outer: str) -> None:
    assert {package: found[outer] for package, found in graph.items() if "pipeline" in package and outer in found} == {}


def test_stages_import_neither_training_nor_benchmarks(graph: Graph) -> None:
    assert {outer: graph["stages"][outer] for outer in ("training", "benchmarks") if outer in graph["stages"]} == {}


def test_the_viewer_alone_imports_rerun(graph: Graph) -> None:
    assert [package for package, found in graph.items() if "rerun" in found] == ["pipeline.viewer"]


def test_the_app_alone_serves_pages_and_none_needs_a_framework_for_it(graph: Graph) -> None:
    assert [package for package, found in graph.items() if "http" in found] == ["pipeline.app"]
    frameworks = {"aiohttp", "fastapi", "flask", "gradio", "playwright", "starlette", "streamlit"}
    assert {
        package: sorted(frameworks & set(found)) for package, found in graph.items() if frameworks & set(found)
    } == {}


def test_no_number_is_set_by_hand_beyond_those_that_are(tmp_path: Path) -> None:
    assert len(list(hand_set_numbers(ROOT))) <= MOST_NUMBERS
    (tmp_path / "pipeline").mkdir()
    text = "NEAR = 0.5\nname = 3\ndef f(a=4, b=1):\n    return a > 2.5 and b == 0\n"
    (tmp_path / "pipeline/one.py").write_text(text)
    assert sorted(hand_set_numbers(tmp_path)) == [f"pipeline/one.py:{line}" for line in (1, 3, 4)]


def test_imports_in_functions_and_for_types_close_a_circle(tmp_path: Path) -> None:
    files = {
        "pipeline/a/one.py": "import numpy\ndef f():\n    from pipeline.b import two\n",
        "pipeline/b/two.py": "import typing\nif typing.TYPE_CHECKING:\n    from pipeline.c.three import X\n",
        "pipeline/c/three.py": "from ..a.one import f\n",
        "pipeline/d.py": "import pipeline.a.one\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    found = circle(import_graph(tmp_path))
    assert len(found) == 3 and any("pipeline.b imports pipeline.c in ['pipeline/b/two.py']" in line for line in found)
    (tmp_path / "pipeline/c/three.py").write_text("import stages.score\n")
    graph = import_graph(tmp_path)
    assert circle(graph) == [] and graph["pipeline.c"]["stages"] == ["pipeline/c/three.py"]


def test_a_circle_of_files_in_one_package_is_found(tmp_path: Path) -> None:
    (tmp_path / "pipeline/a").mkdir(parents=True)
    (tmp_path / "pipeline/a/one.py").write_text("def f():\n    from pipeline.a.two import g\n")
    (tmp_path / "pipeline/a/two.py").write_text("import numpy\n")
    assert file_circle(tmp_path) == []
    (tmp_path / "pipeline/a/two.py").write_text("from pipeline.a.one import f\n")
    assert set(file_circle(tmp_path)) == {"pipeline/a/one.py", "pipeline/a/two.py"}
