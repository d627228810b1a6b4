"""Best-of-K: replay each sampled answer, score it against the clip, rank.

Reads data/infer/<suite>, data/render/<suite> (masks), data/flow/<suite>. Writes data/best_of_k/<suite>: clip, rank
(0 is best), sample, scene, reward, iou, epe_frame, valid. Parameters: clip, search.
Run: python -m stages.best_of_k SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from pipeline.clips.schedule import Schedule
from pipeline.scene.text import read_scene
from pipeline.search.best_of_k import rank
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.search_target import shard_evaluator
from stages.graph.stage_params import load

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "rank": pa.int32(),
        "sample": pa.int32(),
        "scene": pa.string(),
        "reward": pa.float64(),
        "iou": pa.float64(),
        "epe_frame": pa.float64(),
        "valid": pa.bool_(),
    }
)


@dataclass(frozen=True)
class Parameters:
    """size: width and height at which the answers are compared, px."""

    schedule: Schedule
    size: tuple[int, int]


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    answers, rendered, flow = inputs
    rows = []
    for clip in shard.clips:
        samples = [row for row in answers.rows(clip) if row["sample"] >= 0]
        evaluator = shard_evaluator(rendered, flow, clip, parameters.schedule, parameters.size)
        ranking = rank(evaluator, [read_scene(row["scene"]) for row in samples])
        r = ranking.rewards
        rows += [
            {
                "clip": clip,
                "rank": place,
                "sample": samples[i]["sample"],
                "scene": samples[i]["scene"],
                "reward": r.reward[i],
                "iou": r.iou[i],
                "epe_frame": r.epe_frame[i],
                "valid": bool(r.valid[i]),
            }
            for place, i in enumerate(ranking.order)
        ]
    notes = {"simulations": len(rows), "invalid": sum(not row["valid"] for row in rows)}
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes=notes)


def main(suite: str) -> None:
    params = load("best_of_k", suite)
    parameters = Parameters(params.clip.schedule, params.search.size)
    run_shards("best_of_k", suite, compute, parameters, ["infer", "render", "flow"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
