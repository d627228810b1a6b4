"""Which parameters each stage reads, and a view of params.yaml that shows a stage these alone.

A stage's line in `READS` must be its `params:` in dvc.yaml (tests/test_dvc_graph.py compares them). No stage reads the
section `executor`: the number of workers must not run anything again.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from pipeline.errors import ParamsError, did_you_mean
from stages.graph.params import PARAMS_FILE, ExecutorSettings, Params
from stages.graph.params_file import read_params_file

SHOWN = ("flow.picture", "flow.width", "flow.height", "flow.iterations")
"""With the flow's source, what a checkpoint records of its input."""

READS: dict[str, tuple[str, ...]] = {
    "sample": ("seed", "sample", "clip", "suites.{suite}"),
    "compile": (),
    "simulate": ("clip",),
    "render": ("seed", "clip", "render", "model.input", "flow.train_source"),
    "import_clips": ("clip", "suites.real", "sample.shard_size"),
    "flow": ("seed", "clip", "flow"),
    "events": ("clip", "events", "sample.filters.visible_px"),
    "tokenize": ("clip", "model.base", "model.reasoning", "model.width", "model.height"),
    "finetune": ("seed", "clip", *SHOWN, "flow.train_source", "model", "finetune", "training", "infer.shots"),
    "prefer": (
        "seed",
        "clip",
        *SHOWN,
        "flow.source",
        "model.base",
        "model.input",
        "model.sees",
        "model.reasoning",
        "model.dtype",
        "search.width",
        "search.height",
        "prefer",
        "training",
        "infer.shots",
    ),
    "regress": ("seed", "clip", "model.input", "sample.distribution", "regress"),
    "infer": ("seed", "clip", *SHOWN, "flow.source", "model", "infer"),
    "best_of_k": ("clip", "search"),
    "cmaes": ("seed", "clip", "search", "cmaes"),
    "fit": ("seed", "clip", "search", "fit"),
    "predict": ("seed", "clip", "search.width", "search.height", "predict"),
    "tracks": ("clip", "search", "tracks"),
    "hide": ("seed", "hide"),
    "discover": ("seed", "discover"),
    "hide_filmed": ("seed", "hide_filmed"),
    "discover_filmed": ("seed", "discover"),
    "score": (
        "seed",
        "clip",
        "events",
        "sample.filters.visible_px",
        "score",
        "model",
        "flow.source",
        "infer.shots",
        "regress.enabled",
    ),
}
"""The keys that each stage reads, as narrow as can be; `{suite}` is the suite that the stage runs for."""


def declared_keys(stage: str, suite: str | None = None) -> tuple[str, ...]:
    """The keys that a stage reads, for a suite where it runs for one."""
    return tuple(key.format(suite=suite) for key in READS[stage])


def load(stage: str, suite: str | None = None, path: Path = PARAMS_FILE) -> Params:
    """The parameters of a stage; reading one that it has not declared is an AssertionError.

    Raises ParamsError, naming the key, for an unknown, missing or impossible parameter anywhere in the file.
    """
    params = read_params_file(path, Params)
    return ParamsView.of(params, declared_keys(stage, suite), stage, path)  # type: ignore[return-value]


def load_executor(path: Path = PARAMS_FILE) -> ExecutorSettings:
    """Who computes, and with how many workers; declared by no stage."""
    return read_params_file(path, Params).executor


class ParamsView:
    """Stands for a section of which only some keys are declared; reading another is an AssertionError.

    A declared key gives the value itself (a whole section, where a section is declared).
    """

    def __init__(self, value: Any, path: str, declared: frozenset[str]) -> None:
        self._value, self._path, self._declared = value, path, declared

    @staticmethod
    def of(params: BaseModel, declared: Iterable[str], stage: str, file: Path) -> "ParamsView":
        """A view of all `params`. Raises ParamsError where a declared key is not in them (an unknown suite)."""
        declared = frozenset(declared)
        for key in declared:
            value: Any = params
            for part in key.split("."):
                inner = _children(value)
                if part not in inner:
                    raise ParamsError(
                        f"{file}: stage {stage} reads `{key}`, and `{part}` is not there{did_you_mean(part, inner)}; "
                        f"valid: {', '.join(inner)}"
                    )
                value = inner[part]
        return ParamsView(params, "", declared)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self._child(name)

    def __getitem__(self, name: str) -> Any:
        return self._child(name)

    def _child(self, name: str) -> Any:
        path = f"{self._path}.{name}".removeprefix(".")
        if path in self._declared:
            return _children(self._value)[name]
        if any(key.startswith(f"{path}.") for key in self._declared):
            return ParamsView(_children(self._value)[name], path, self._declared)
        raise AssertionError(f"`{path}` is read but not declared; add it to READS ({__name__}) and dvc.yaml")


def _children(value: Any) -> Mapping[str, Any]:
    if isinstance(value, BaseModel):
        return {name: getattr(value, name) for name in type(value).model_fields}
    return value if isinstance(value, Mapping) else {}
