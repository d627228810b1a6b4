"""How a stage runs: its command line, and its shards in data/<stage>/<suite>."""

import importlib
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pipeline.errors import DynamicsError
from pipeline.shards.manifest import Manifest
from pipeline.shards.map_shards import Compute, Parameters, map_shards
from pipeline.shards.prune import LIMIT_ENVIRONMENT, prune, store_limit
from pipeline.shards.store import default_store
from stages.graph.lock_copy import keep
from stages.graph.stage_params import load_executor

DATA = Path("data")


def run(main: Callable[..., None], arguments: list[str] | None = None) -> None:
    """Call a stage's `main` with the words of the command line (mostly a suite's name) and exit with its outcome.

    Exit code 0: done. 2: the user's data or settings are at fault, or the words do not fit; one line on stderr and no
    traceback. 130: Ctrl-C. Any other error is a defect and shows its traceback.
    """
    words = sys.argv[1:] if arguments is None else arguments
    try:
        inspect.signature(main).bind(*words)
    except TypeError:
        module = inspect.getmodule(main)
        name = module.__spec__.name if module and module.__spec__ else main.__module__
        expected = " ".join(parameter.upper() for parameter in inspect.signature(main).parameters)
        print(f"error: usage: python -m {name} {expected}".rstrip(), file=sys.stderr)
        sys.exit(2)
    keep()
    try:
        limit = store_limit()
        _of_module(main)(*words)
        if limit is not None:
            _shrink_store(limit)
    except DynamicsError as error:
        notes = "".join(f" ({note})" for note in getattr(error, "__notes__", []))
        print(f"error: {error}{notes}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("error: interrupted; what was computed is in the store, run it again to go on", file=sys.stderr)
        sys.exit(130)


def _shrink_store(limit: int) -> None:
    """Remove what was not used for the longest time until the store keeps to its limit."""
    removed = prune(default_store(), keep_bytes=limit)
    if removed.bytes:
        print(f"store: {removed.bytes / 2**20:.0f} MiB removed ({LIMIT_ENVIRONMENT})", flush=True)


def _of_module(main: Callable[..., None]) -> Callable[..., None]:
    """`main` of the module by its own name instead of `__main__`, which processes on other machines do not have."""
    module = sys.modules[main.__module__]
    if main.__module__ != "__main__" or module.__spec__ is None or main.__qualname__ != main.__name__:
        return main
    return getattr(importlib.import_module(module.__spec__.name), main.__name__)


def folder(stage: str, suite: str) -> Path:
    """Where a stage's shards of a suite are."""
    return DATA / stage / suite


def run_shards(
    stage: str,
    suite: str,
    compute: Compute[Parameters],
    parameters: Parameters,
    inputs: Sequence[str] = (),
    *,
    output: str | None = None,
    clips: int | None = None,
    shard_size: int | None = None,
    files: Mapping[str, Path] | None = None,
    versions: Sequence[str] = (),
) -> Manifest:
    """`map_shards` with the folders of the graph and the executor of params.yaml.

    Args:
        stage: The stage's name.
        suite: The suite's name.
        compute: As for `map_shards`, like the arguments that are not listed here.
        parameters: The stage's record of parameters.
        inputs: The stages whose shards of the same suite `compute` gets.
        output: The folder under data/ that is written; None for the stage's name.
    """
    executor = load_executor()
    return map_shards(
        stage,
        suite,
        folder(output or stage, suite),
        compute,
        parameters=parameters,
        clips=clips,
        shard_size=shard_size,
        inputs=[folder(name, suite) for name in inputs],
        files=files,
        versions=versions,
        executor=executor.name,
        workers=executor.workers,
    )
