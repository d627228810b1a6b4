"""Render clips: RGB, instance masks, depth, exact flow.

Reads data/sample/<suite> and data/simulate/<suite>. Writes data/render/<suite>: arrays mask (F, H, W), depth
(P, H, W) and exact flow (P, H, W, 2) of the model's frames, rgb (F, H, W, 3). RGB of the training clips is made only
where something reads it: model.input=rgb, or a flow.train_source that looks at pictures.
Parameters: seed, clip, render, model.input, flow.train_source. Run: python -m stages.render SUITE
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks, pair_view, trace_pairs
from pipeline.physics.trace_shards import read_trace
from pipeline.scene.text import read_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.render import render_rgb
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    sample, simulated = inputs
    schedule = Schedule(**p["clip"])
    size = (p["width"], p["height"])
    names = ("mask", "depth", "flow", "rgb") if p["rgb"] else ("mask", "depth", "flow")
    arrays: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for row in sample.table().to_pylist():
        scene, trace = read_scene(row["scene"]), read_trace(simulated, row["clip"])
        view = pair_view(scene, *trace_pairs(trace, schedule), *size)
        arrays["mask"].append(frame_masks(scene, trace, schedule, *size))
        arrays["depth"].append(view.depth)
        arrays["flow"].append(view.flow)
        if p["rgb"]:
            rng = clip_rng(p["seed"], shard.suite, row["clip"], "appearance")
            appearance = sample_appearance(rng, len(scene.objects), **p["appearance"])
            steps = schedule.frame_steps
            frames = render_rgb(scene, trace.position[steps], trace.quaternion[steps], appearance, *size, p["backend"],
                                p["shadows"])  # fmt: skip
            arrays["rgb"].append(apply_sensor(frames, sample_sensor(rng, **p["sensor"]), rng))
    return ShardResult(arrays={name: np.stack(a) for name, a in arrays.items()})


def main(suite: str) -> None:
    params = load("render", suite)
    r = params.render
    needed = suite != "train" or params.model.input == "rgb" or params.flow.train_source != "exact"
    parameters: dict[str, Any] = {"clip": params.clip.model_dump(), "width": r.width, "height": r.height, "rgb": needed}
    if needed:
        backend, reason = choose_backend(r.backend)
        print(f"render {suite}: pictures by {backend} ({reason})", flush=True)
        parameters |= {
            "seed": params.seed,
            "backend": backend,
            "shadows": r.shadows,
            "appearance": {
                "textures": r.textures,
                "floor_textures": r.floors,
                "backdrops": r.backdrops,
                "max_lights": r.lights,
                "metal_probability": r.metal,
            },
            "sensor": {"noise": [0.0, r.sensor_noise], "blur": [0.0, r.blur]},
        }
    run_shards("render", suite, compute, parameters, ["sample", "simulate"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
