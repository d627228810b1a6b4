"""Scenes of clips as people film them, without a model: from tracks, and by the search where these do not explain one.

Reads data/sample/<suite> (true scenes) and data/render/<suite> (true masks, RGB, exact flow). Writes
data/tracks/<suite>: a row per clip with the true and the found view, sequence IoU, errors of the camera's roll and of
the ramp's slope, and the grade. Parameters: clip, search, tracks. Run: python -m stages.tracks SUITE
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pyarrow as pa

from pipeline.clips.schedule import Schedule
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
        "by": pa.string(),
        "grade": pa.string(),
        "beats_constant_velocity": pa.bool_(),
    }
)


@dataclass(frozen=True)
class Parameters:
    """size: px, width and height, of masks and flow in the search; simulations: of the search."""

    schedule: Schedule
    size: tuple[int, int]
    simulations: int


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    # imported here: it takes seconds, and mostly the shards are in the store
    from pipeline.clips.draw_views import view_kind
    from pipeline.report.view_scores import SeenClip, view_score
    from pipeline.scene.text import read_scene

    (sample, rendered), p = inputs, parameters
    rows = []
    for row in sample.table().to_pylist():
        clip = row["clip"]
        masks, frames, flow = (np.asarray(rendered.array(clip, name)) for name in ("mask", "rgb", "flow"))
        seen = SeenClip(masks, frames, flow, p.schedule)
        truth = read_scene(row["scene"])
        score = view_score(clip, view_kind(clip), truth, seen, size=p.size, simulations=p.simulations)
        rows.append(asdict(score))
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def main(suite: str) -> None:
    params = load("tracks", suite)
    parameters = Parameters(params.clip.schedule, params.search.size, params.tracks.simulations)
    run_shards("tracks", suite, compute, parameters, ["sample", "render"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
