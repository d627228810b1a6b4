"""Optical flow of the model's frames, and the picture of it that the model is shown.

Reads data/render/<suite>. Writes data/flow/<suite>: arrays flow (P, H, W, 2), px per frame interval, and picture
(P, H, W, 3) uint8 (with model.input=rgb the frames themselves take the picture's place, downstream).
flow.source is used for every suite but train, which takes flow.train_source; exact flow gets noise in train.
Parameters: seed, clip, flow. Run: python -m stages.flow SUITE
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.errors import ModelError
from pipeline.scene.mjcf import STEPS_PER_SECOND
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.flow_noise import add_raft_noise
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT, load_raft
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards


@lru_cache(maxsize=1)
def estimator(source: str, raft: str) -> RAFT | DIS:
    return load_raft(raft) if source == "raft" else DIS("medium")


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    (rendered,) = inputs
    schedule = Schedule(**p["clip"])
    flows, pictures = [], []
    for clip in shard.clips:
        if p["source"] == "exact":
            flow = rendered.array(clip, "flow")
            if p["noise"]:
                rng = clip_rng(p["seed"], shard.suite, clip, "flow noise")
                masks = rendered.array(clip, "mask")[schedule.pairs[:, 0]]
                flow = add_raft_noise(rng, flow, masks, p["noise"])
        else:
            rgb = rendered.array(clip, "rgb")
            recorded = rendered.row(clip)["recorded"] if rendered.tables else schedule.frame_steps / STEPS_PER_SECOND
            model = estimator(p["source"], p.get("raft", ""))
            flow = measured_flow(model, rgb, np.array(recorded), schedule.pairs, p["interval"], p["iterations"],
                                 tuple(p["size"]))  # fmt: skip
        flows.append(flow.astype(np.float32))
        pictures.append(flow_picture(flow, p["picture"], scaled_max_px(flow.shape[2], p["interval"])))
    return ShardResult(arrays={"flow": np.stack(flows), "picture": np.stack(pictures)})


def main(suite: str) -> None:
    params = load("flow", suite)
    f = params.flow
    source = f.train_source if suite == "train" else f.source
    if suite == "real" and source == "exact":
        source = "raft"
        print("flow real: a video has no exact flow; RAFT's is used", flush=True)
    parameters: dict[str, Any] = {"clip": params.clip.model_dump(), "source": source, "picture": f.picture,
                                  "interval": 1 / params.clip.fps, "noise": 0.0}  # fmt: skip
    files = {}
    if source == "exact":
        if suite == "train":
            parameters |= {"noise": f.noise, "seed": params.seed}
    else:
        parameters |= {"size": [f.width, f.height], "iterations": f.iterations}
    if source == "raft":
        if not Path(f.raft).exists():
            raise ModelError(
                f"flow.raft: {f.raft} is missing; models/raft-small ships with the repository, or give the path of a "
                "published checkpoint (raft-things.pth)"
            )
        parameters |= {"raft": f.raft}
        files = {"raft": Path(f.raft)}
    run_shards("flow", suite, compute, parameters, ["render"], files=files,
               versions=["torch", "opencv-python-headless"])  # fmt: skip


if __name__ == "__main__":
    run(main)
