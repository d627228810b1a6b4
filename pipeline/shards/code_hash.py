"""A hash of the code of a module and of all modules of the project that it imports, found without running them.

Comments, layout and docstrings do not count, so that a change of words computes nothing again.
"""

import ast
import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("pipeline", "stages", "training")

PLUMBING = (
    "pipeline.shards",
    "pipeline.errors",
    "pipeline.untrusted",
    "stages.graph.lock_copy",
    "stages.graph.params",
    "stages.graph.params_file",
    "stages.graph.run",
    "stages.graph.stage_params",
)
"""Modules that decide when and where something is computed, not what. They are in no key and in no stage's deps; else
a new section in stages/graph/params.py would train the model again. CONTENT lists the exceptions. The other modules of
stages/graph decide what a stage computes, and are in the keys of the stages that import them."""

CONTENT = ("pipeline.shards.tables", "pipeline.shards.arrays", "pipeline.shards.clip_rng")
"""Plumbing that decides bytes: in every key."""


def function_code(function: Callable[..., Any]) -> str:
    """The code hash of a function's module, with the plumbing that decides bytes."""
    files = set(module_closure(_module_file(function)))
    files |= {path for name in CONTENT if (path := _find(name, ROOT)) is not None}
    return hash_code(files)


def hash_code(files: Iterable[Path], root: Path = ROOT) -> str:
    """SHA-256 over the code of `files`, by their paths relative to `root` (names alone outside of it)."""
    digest = hashlib.sha256()
    for path in sorted(files):
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
        digest.update(f"{name}\0{_code(path)}\0".encode())
    return digest.hexdigest()


def module_closure(file: Path, root: Path = ROOT, without: tuple[str, ...] = PLUMBING) -> frozenset[Path]:
    """The files of a module and of all modules of PACKAGES that it imports, directly or not.

    Imports inside functions count; those under `if TYPE_CHECKING:` do not.

    Args:
        file: The module's file.
        root: The folder that holds the packages.
        without: Modules and packages that are not followed.
    """
    file = file.resolve()
    found, waiting = {file}, [file]
    while waiting:
        for name in _imported_names(waiting.pop(), root):
            if name.split(".")[0] not in PACKAGES or _is_one_of(name, without):
                continue
            path = _find(name, root)
            if path is not None and path not in found:
                found.add(path)
                waiting.append(path)
    return frozenset(found)


def _module_file(function: Callable[..., Any]) -> Path:
    file = sys.modules[function.__module__].__file__
    assert file is not None
    return Path(file)


def _is_one_of(name: str, modules: tuple[str, ...]) -> bool:
    return any(name == module or name.startswith(module + ".") for module in modules)


def _find(name: str, root: Path) -> Path | None:
    base = root.joinpath(*name.split("."))
    for path in (base / "__init__.py", base.with_suffix(".py")):
        if path.is_file():
            return path.resolve()
    return None


def _imported_names(file: Path, root: Path) -> frozenset[str]:
    """Every dotted name that `file` may import, with its parents; some are attributes and no modules."""
    return _imported_by_version(file, root, *_version(file))


@cache
def _imported_by_version(file: Path, root: Path, *_: int) -> frozenset[str]:
    names: set[str] = set()
    for name in (*_direct_imports(file, root), *_walked_packages(file, root)):
        parts = name.split(".")
        names.update(".".join(parts[: k + 1]) for k in range(len(parts)))
    return frozenset(names)


def _direct_imports(file: Path, root: Path) -> Iterator[str]:
    for node in _walk_runtime(_parse(file)):
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                base = ".".join(filter(None, (_package(file, root, level), module)))
                yield base
                yield from (f"{base}.{alias.name}" for alias in names if alias.name != "*")
            case ast.Call(func=ast.Name(id="import_module") | ast.Attribute(attr="import_module"), args=[argument, *_]):
                if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
                    yield argument.value


def _walked_packages(file: Path, root: Path) -> Iterator[str]:
    """The modules of packages that `file` imports and walks by their `__path__`, as registries do."""
    walked = {
        n.value.id
        for n in _walk_runtime(_parse(file))
        if isinstance(n, ast.Attribute) and n.attr == "__path__" and isinstance(n.value, ast.Name)
    }
    for name in _direct_imports(file, root) if walked else ():
        folder = root.joinpath(*name.split("."))
        if name.rpartition(".")[2] in walked and folder.is_dir():
            yield from (f"{name}.{path.stem}" for path in sorted(folder.glob("*.py")) if path.stem != "__init__")


def _package(file: Path, root: Path, level: int) -> str:
    """The dotted package that `level` dots mean in `file`; empty for an absolute import."""
    if level == 0 or not file.is_relative_to(root):
        return ""
    parts = file.relative_to(root).parts[:-1]
    return ".".join(parts[: len(parts) - (level - 1)])


def _walk_runtime(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    if isinstance(node, ast.If) and _is_type_checking(node.test):
        children: Iterable[ast.AST] = node.orelse
    else:
        children = ast.iter_child_nodes(node)
    for child in children:
        yield from _walk_runtime(child)


def _is_type_checking(test: ast.expr) -> bool:
    return (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING") or (
        isinstance(test, ast.Attribute) and test.attr == "TYPE_CHECKING"
    )


def _version(file: Path) -> tuple[int, int]:
    """What changes when a file does."""
    found = file.stat()
    return found.st_mtime_ns, found.st_size


def _parse(file: Path) -> ast.Module:
    """The module's tree without docstrings."""
    return _parse_version(file, *_version(file))


@cache
def _parse_version(file: Path, *_: int) -> ast.Module:
    tree = ast.parse(file.read_bytes(), filename=str(file))
    for node in ast.walk(tree):
        match node:
            case ast.Module() | ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef():
                node.body = node.body[ast.get_docstring(node, clean=False) is not None :]
    return tree


def _code(file: Path) -> str:
    return _code_version(file, *_version(file))


@cache
def _code_version(file: Path, *_: int) -> str:
    return ast.dump(_parse(file))
