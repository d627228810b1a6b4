"""How every sharded stage runs: data/<stage>/<suite>, inputs by stage name, the executor of params.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.shards.manifest import Manifest
from pipeline.shards.map_shards import Compute, map_shards
from stages.graph.params import load_executor

DATA = Path("data")


def folder(stage: str, suite: str) -> Path:
    """Where a stage's shards of a suite are."""
    return DATA / stage / suite


def run_shards(
    stage: str,
    suite: str,
    compute: Compute,
    parameters: Mapping[str, Any],
    inputs: Sequence[str] = (),
    output: str | None = None,
    **options: Any,
) -> Manifest:
    """`map_shards` into data/<output or stage>/<suite> from the same suite's shards of the stages `inputs`."""
    settings = load_executor()
    return map_shards(
        stage,
        suite,
        folder(output or stage, suite),
        compute,
        parameters=parameters,
        inputs=[folder(name, suite) for name in inputs],
        executor=settings.name,
        workers=settings.workers,
        **options,
    )
