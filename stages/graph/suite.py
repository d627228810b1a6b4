"""A suite's shards of several stages, side by side."""

from collections.abc import Sequence
from typing import Any

from pipeline.clips.schedule import Schedule
from pipeline.evaluation.scene_scores import Reference, measured_reference, true_reference
from pipeline.scene.text import read_scene
from pipeline.shards.dataset import ShardedDataset, open_shards
from stages.graph.run import folder

Suite = dict[str, ShardedDataset]


def open_suite(suite: str, stages: Sequence[str]) -> Suite:
    """What these stages made of a suite, by stage; of a sampled one also its scenes, `sample`."""
    return {name: open_shards(folder(name, suite)) for name in [*stages, *["sample"] * (suite != "real")]}


def reference(suite: Suite, clip: int, schedule: Schedule) -> Reference:
    """A sampled clip's own exact replay; for a real clip the masks and the flow that were measured."""
    if "sample" in suite:
        return true_reference(read_scene(suite["sample"][clip].row()["scene"]), schedule)
    masks, first = suite["render"][clip].array("mask"), schedule.pairs[:, 0]
    return measured_reference(masks, suite["flow"][clip].array("flow"), first)


def greedy_row(suite: Suite, clip: int) -> dict[str, Any]:
    return next(row for row in suite["infer"][clip].rows() if row["sample"] < 0)
