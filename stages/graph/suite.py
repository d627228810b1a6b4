"""A suite's shards of several stages, side by side."""

from collections.abc import Sequence

from pipeline.report.suite import Suite
from pipeline.shards.dataset import open_shards
from stages.graph.run import folder


def open_suite(suite: str, stages: Sequence[str]) -> Suite:
    """What these stages made of a suite, by stage; of a sampled one also its scenes, `sample`."""
    return {name: open_shards(folder(name, suite)) for name in [*stages, *["sample"] * (suite != "real")]}
