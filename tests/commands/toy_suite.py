"""A suite of two clips, made by the stages' own functions: data/<stage>/toy under a root."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import small_clip

from pipeline.clips.events import DEFAULT_THRESHOLDS
from pipeline.clips.schedule import Schedule
from pipeline.scene.text import write_scene
from pipeline.shards.map_shards import Compute, map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.store import Store
from pipeline.shards.tables import table_from_rows
from stages import compile as compile_stage
from stages import events, flow, infer, render, sample, simulate

CLIPS = 2
SCHEDULE = Schedule(seconds=1.0, fps=30, model_frames=10)
SIZE = (120, 80)
PICTURES = render.Pictures(
    seed=1,
    backend="raycast",
    shadows=False,
    textures={"plain": 1.0},
    floors={"plain": 1.0},
    backdrops={"plain": 1.0},
    lights=1,
    metal=0.0,
    sensor_noise=0.0,
    blur=0.0,
)
DIS = flow.Estimator(raft=None, size=SIZE, iterations=1, fill=True)


def given_scenes(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `sample`: the same scene for every clip."""
    scene = small_clip.scene()
    rows = [{"clip": c, "composition": scene.composition, "scene": write_scene(scene)} for c in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, sample.SCHEMA)})


def given_answers(shard: Shard, inputs: Sequence[OpenShard], parameters: None) -> ShardResult:
    """In the place of `infer`: a greedy answer that is the truth, and a sample."""
    text = write_scene(small_clip.scene())
    rows = [
        {"clip": c, "sample": k, "text": "", "scene": text, "log_probability": 0.0}
        for c in shard.clips
        for k in (-1, 0)
    ]
    return ShardResult({"clips": table_from_rows(rows, infer.SCHEMA)})


def make_suite(root: Path) -> None:
    store = Store(root / "store")

    def stage(name: str, compute: Compute[Any], parameters: object, *inputs: str) -> None:
        cut = {} if inputs else {"clips": CLIPS, "shard_size": 1}
        map_shards(
            name,
            "toy",
            root / "data" / name / "toy",
            compute,
            parameters=parameters,
            inputs=[root / "data" / i / "toy" for i in inputs],
            workers=1,
            store=store,
            **cut,
        )

    stage("sample", given_scenes, None)
    stage("compile", compile_stage.compute, None, "sample")
    stage("simulate", simulate.compute, simulate.Parameters(SCHEDULE), "compile")
    stage("render", render.compute, render.Parameters(SCHEDULE, SIZE, PICTURES), "sample", "simulate")
    stage("events", events.compute, events.Parameters(SCHEDULE, DEFAULT_THRESHOLDS), "sample", "simulate")
    stage("flow", flow.compute, flow.Parameters(SCHEDULE, "channels", DIS, None), "render")
    stage("infer", given_answers, None, "flow")
