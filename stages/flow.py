"""Optical flow of the model's frames, and the picture of it that the model is shown.

Reads data/render/<suite>. Writes data/flow/<suite>: arrays flow (P, H, W, 2), px per frame interval, its confidence
(P, H, W) uint8, 255 for certain, and picture (P, H, W, 3) uint8 (with model.input=rgb later stages show the model the
frames instead). With flow.confidence, what measured flow does not show is filled in by the masks.
The flow of train is made as flow.train_source says, that of other suites as flow.source says; exact flow gets noise in
train.
Parameters: seed, clip, flow. Run: python -m stages.flow SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.errors import ModelError
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.vision.flow.flow_noise import add_raft_noise
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

if TYPE_CHECKING:
    from pipeline.vision.flow.dis import DIS
    from pipeline.vision.flow.raft import RAFT
    from pipeline.vision.flow.supported_flow import SupportedFlow


@dataclass(frozen=True)
class Noise:
    """Noise on exact flow; strength: 1 for that of RAFT's flow."""

    seed: int
    strength: float


@dataclass(frozen=True)
class Estimator:
    """What measures flow in pictures.

    Attributes:
        raft: The weights of RAFT; None for DIS.
        size: Width and height at which it works, px.
        iterations: Of RAFT.
        fill: Whether what was not measured is filled in.
    """

    raft: Path | None
    size: tuple[int, int]
    iterations: int
    fill: bool


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        schedule: The frames of a clip.
        picture: How flow is shown: channels or wheel.
        estimator: None for the exact flow of the shards.
        noise: On exact flow; None for none.
    """

    schedule: Schedule
    picture: str
    estimator: Estimator | None
    noise: Noise | None


@lru_cache(maxsize=1)
def load_estimator(raft: Path | None) -> "RAFT | DIS":
    # imported here, as below: it takes seconds, and mostly the shards are in the store
    from pipeline.vision.flow.dis import DIS
    from pipeline.vision.flow.raft import load_raft

    return DIS("medium") if raft is None else load_raft(raft)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (rendered,) = inputs
    schedule, noise = parameters.schedule, parameters.noise
    interval = 1 / schedule.fps
    flows, confidences, pictures = [], [], []
    for clip in shard.clips:
        if parameters.estimator:
            found = estimated(rendered, clip, schedule, parameters.estimator)
            flow, confidence = found.flow, found.confidence
        else:
            flow = rendered.array(clip, "flow")
            if noise:
                rng = clip_rng(noise.seed, shard.suite, clip, "flow noise")
                masks = rendered.array(clip, "mask")[schedule.pairs[:, 0]]
                flow = add_raft_noise(rng, flow, masks, noise.strength)
            confidence = np.ones(flow.shape[:-1], np.float32)
        flows.append(flow.astype(np.float32))
        confidences.append(np.rint(255 * confidence).astype(np.uint8))
        pictures.append(flow_picture(flow, parameters.picture, scaled_max_px(flow.shape[2], interval)))
    return ShardResult(
        arrays={"flow": np.stack(flows), "confidence": np.stack(confidences), "picture": np.stack(pictures)}
    )


def estimated(rendered: OpenShard, clip: int, schedule: Schedule, estimator: Estimator) -> "SupportedFlow":
    """The flow of a clip's frames, and the confidence in it."""
    from pipeline.vision.flow.measured_flow import measured_flow
    from pipeline.vision.flow.supported_flow import SupportedFlow, supported_flow

    rgb = rendered.array(clip, "rgb")
    recorded = np.array(rendered.row(clip)["recorded"] if rendered.tables else schedule.frame_steps / STEPS_PER_SECOND)
    interval = 1 / schedule.fps
    raft = load_estimator(estimator.raft)
    flow = measured_flow(raft, rgb, recorded, schedule.pairs, interval, estimator.iterations, estimator.size)
    if not estimator.fill:
        return SupportedFlow(flow, np.ones(flow.shape[:-1], np.float32))
    masks = rendered.array(clip, "mask")
    return supported_flow(flow, rgb, masks, recorded, schedule.pairs, interval=interval, size=estimator.size)


def main(suite: str) -> None:
    params = load("flow", suite)
    f = params.flow
    source = f.train_source if suite == "train" else f.source
    if suite == "real" and source == "exact":
        source = "raft"
        print("flow real: a video has no exact flow; RAFT's is used", flush=True)
    raft = Path(f.raft) if source == "raft" else None
    if raft and not raft.exists():
        raise ModelError(
            f"flow.raft: {raft} is missing; models/raft-small ships with the repository, or give the path of a "
            "published checkpoint (raft-things.pth)"
        )
    parameters = Parameters(
        schedule=params.clip.schedule,
        picture=f.picture,
        estimator=None if source == "exact" else Estimator(raft, (f.width, f.height), f.iterations, f.confidence),
        noise=Noise(params.seed, f.noise) if source == "exact" and suite == "train" and f.noise else None,
    )
    files, versions = {"raft": raft} if raft else {}, ["torch", "opencv-python-headless"]
    run_shards("flow", suite, compute, parameters, ["render"], files=files, versions=versions)


if __name__ == "__main__":
    run(main)
