"""A suite of two clips, made by the stages' own functions: data/<stage>/toy under a root."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import small_clip

from pipeline.scene.text import write_scene
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.store import Store
from pipeline.shards.tables import table_from_rows
from stages import compile as compile_stage
from stages import events, flow, infer, render, sample, simulate

CLIPS = 2
CLIP = {"seconds": 1.0, "fps": 30, "model_frames": 10}
EVENTS = {"impact_speed": 0.2, "separation": 0.1, "slip_speed": 0.05, "moving_speed": 0.03, "duration": 0.1, "most": 12,
          "visible_px": 32.0}  # fmt: skip
LOOK = {
    "textures": {"plain": 1.0}, "floor_textures": {"plain": 1.0}, "backdrops": {"plain": 1.0}, "max_lights": 1,
    "metal_probability": 0.0,
}  # fmt: skip
RENDER = {"clip": CLIP, "width": 120, "height": 80, "rgb": True, "seed": 1, "backend": "raycast", "shadows": False,
          "appearance": LOOK, "sensor": {"noise": [0.0, 0.0], "blur": [0.0, 0.0]}}  # fmt: skip
FLOW = {"clip": CLIP, "source": "dis", "picture": "channels", "interval": 1 / 30, "noise": 0.0, "size": [120, 80],
        "iterations": 1}  # fmt: skip


def given_scenes(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    """In the place of `sample`: the same scene for every clip."""
    scene = small_clip.scene()
    rows = [{"clip": c, "composition": scene.composition, "scene": write_scene(scene)} for c in shard.clips]
    return ShardResult({"clips": table_from_rows(rows, sample.SCHEMA)})


def given_answers(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    """In the place of `infer`: a greedy answer that is the truth, and a sample."""
    text = write_scene(small_clip.scene())
    rows = [{"clip": c, "sample": k, "text": "", "scene": text, "log_probability": 0.0}
            for c in shard.clips for k in (-1, 0)]  # fmt: skip
    return ShardResult({"clips": table_from_rows(rows, infer.SCHEMA)})


def make_suite(root: Path) -> None:
    store = Store(root / "store")

    def stage(name: str, compute: Any, parameters: dict[str, Any], *inputs: str) -> None:
        cut = {} if inputs else {"clips": CLIPS, "shard_size": 1}
        map_shards(name, "toy", root / "data" / name / "toy", compute, parameters=parameters,
                   inputs=[root / "data" / i / "toy" for i in inputs], workers=1, store=store, **cut)  # fmt: skip

    stage("sample", given_scenes, {})
    stage("compile", compile_stage.compute, {}, "sample")
    stage("simulate", simulate.compute, {"clip": CLIP}, "compile")
    stage("render", render.compute, RENDER, "sample", "simulate")
    stage("events", events.compute, {"clip": CLIP, "events": EVENTS}, "sample", "simulate")
    stage("flow", flow.compute, FLOW, "render")
    stage("infer", given_answers, {}, "flow")
