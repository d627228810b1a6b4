"""Scenes from tracks alone, of clips as people film them: no model answers, and nothing searches.

Reads data/sample/<suite> (true scenes) and data/render/<suite> (true masks, RGB). Writes data/tracks/<suite>: a row per
clip with the true and the found view, sequence IoU, errors of the camera's roll and of the ramp's slope, and the grade.
Parameters: clip. Run: python -m stages.tracks SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.clips.draw_views import view_kind
from pipeline.evaluation.view_scores import as_row, view_score
from pipeline.scene.text import read_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "kind": pa.string(),
        "shapes": pa.string(),
        "found": pa.string(),
        "iou": pa.float64(),
        "roll_error": pa.float64(),
        "slope_error": pa.float64(),
        "grade": pa.string(),
        "beats_constant_velocity": pa.bool_(),
    }
)


@dataclass(frozen=True)
class Parameters:
    """fps: frames a second."""

    fps: float


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    sample, rendered = inputs
    rows = []
    for row in sample.table().to_pylist():
        clip = row["clip"]
        masks, frames = (np.asarray(rendered.array(clip, name)) for name in ("mask", "rgb"))
        score = view_score(clip, view_kind(clip), read_scene(row["scene"]), masks, frames, parameters.fps)
        rows.append(as_row(score))
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main(suite: str) -> None:
    parameters = Parameters(load("tracks", suite).clip.fps)
    run_shards("tracks", suite, compute, parameters, ["sample", "render"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
