"""A view of the parameters that shows a stage what it declared, and remembers what was read of it."""

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from pipeline.errors import ParamsError


class ParamsView:
    """Stands for a section of which only some keys are declared; reading another is an AssertionError.

    A declared key gives the value itself (a whole section, where a section is declared).
    """

    def __init__(self, value: Any, path: str, declared: frozenset[str], read: set[str]) -> None:
        self._value, self._path, self._declared, self._read = value, path, declared, read

    @staticmethod
    def of(params: BaseModel, declared: Iterable[str], stage: str, file: Path) -> "ParamsView":
        """A view of all `params`. Raises ParamsError where a declared key is not in them (an unknown suite)."""
        declared = frozenset(declared)
        for key in declared:
            value: Any = params
            for part in key.split("."):
                inner = _children(value)
                if part not in inner:
                    close = difflib.get_close_matches(part, inner, n=1)
                    hint = f"did you mean `{close[0]}`? " if close else ""
                    raise ParamsError(f"{file}: stage {stage} reads `{key}`, and `{part}` is not there; {hint}"
                                      f"Valid: {', '.join(inner)}")  # fmt: skip
                value = inner[part]
        return ParamsView(params, "", declared, set())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self._child(name)

    def __getitem__(self, name: str) -> Any:
        return self._child(name)

    def _child(self, name: str) -> Any:
        path = f"{self._path}.{name}".removeprefix(".")
        if path in self._declared:
            self._read.add(path)
            return _children(self._value)[name]
        if any(key.startswith(f"{path}.") for key in self._declared):
            return ParamsView(_children(self._value)[name], path, self._declared, self._read)
        raise AssertionError(
            f"`{path}` is read but not declared; add it to READS (stages/graph/params.py) and dvc.yaml"
        )


def keys_read(view: Any) -> frozenset[str]:
    """The declared keys that were read so far through what `load` gave."""
    assert isinstance(view, ParamsView)
    return frozenset(view._read)


def _children(value: Any) -> Mapping[str, Any]:
    if isinstance(value, BaseModel):
        return {name: getattr(value, name) for name in type(value).model_fields}
    return value if isinstance(value, Mapping) else {}
