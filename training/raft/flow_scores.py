"""End-point errors of flow estimators on held-out rendered pairs and on clips of another engine.

The foreground error is the mean length of the difference to the exact flow over the pixels of moving bodies in the
first frame, of all pairs together, in px of the pictures' own size (240x160 for the rendered pairs, 360x240 for the
other engine's).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.vision.recordings.video import read_clip
from training.clip_motions import ClipMotions
from training.data_folder import data_folder
from training.frame_pair import FramePair
from training.raft.pair_stream import RENDER_SIZE, Batch, stack
from training.raft.rendered_pairs import project_pair

HELD_OUT_PAIRS = 200
MOVING_PX = 0.05  # mean flow of a body's pixels, above which it counts as moving, where only the flow is known


class Estimator(Protocol):
    """Anything that estimates flow (B, H, W, 2) px from frames (B, H, W, 3) uint8."""

    def flow(self, frames_a: np.ndarray, frames_b: np.ndarray, iterations: int = ...) -> np.ndarray: ...


@dataclass(frozen=True)
class Score:
    """Mean end-point error over the foreground and over all pixels, px, and seconds a pair."""

    foreground: float
    frame: float
    seconds: float


def held_out(seed: int, count: int = HELD_OUT_PAIRS, mujoco: bool = False) -> Batch:
    """One pair of neighbouring frames, with a moving body in view, from each of `count` simulated clips.

    The same seed gives the same pairs. mujoco: whether MuJoCo renders them.
    """
    rng = np.random.default_rng(seed)
    motions = ClipMotions(seed, pairs=1)
    pairs: list[FramePair] = []
    while len(pairs) < count:
        pair = project_pair(rng, motions.draw(rng), *RENDER_SIZE, mujoco)
        if pair.foreground.any():
            pairs.append(pair)
    return stack(pairs)


def score(estimator: Estimator, batch: Batch, iterations: int) -> Score:
    """The errors and the time of an estimator on a batch."""
    start = time.perf_counter()
    flow = estimator.flow(batch.frames_a, batch.frames_b, iterations)
    seconds = (time.perf_counter() - start) / len(flow)
    error = np.linalg.norm(flow - batch.flow_px, axis=-1)
    return Score(float(error[batch.foreground].mean()), float(error.mean()), seconds)


def cross_engine_folder() -> Path | None:
    """The folder `cross_engine` of clips by Blender and Bullet, in DYNAMICS_DATA or beside the repository, or None."""
    folder = data_folder() / "cross_engine"
    return folder if folder.is_dir() else None


def cross_engine(folder: Path, every: int = 4) -> Batch:
    """Every `every`-th pair of neighbouring frames of each clip, at the clips' own size."""
    pairs = []
    for clip in sorted(folder.glob("clip_*")):
        flow = np.load(clip / "flow_depth.npz")["flow_fwd"].astype(np.float32)
        masks = np.load(clip / "masks.npz")["masks"]
        count, height, width = masks.shape
        frames = read_clip(clip / "video.mp4", seconds=count / 30, size=(width, height)).frames
        for t in range(0, count - 1, every):
            moving = [
                i
                for i in np.unique(masks[t][masks[t] > 0])
                if np.linalg.norm(flow[t][masks[t] == i], axis=-1).mean() > MOVING_PX
            ]
            if moving:
                pairs.append(FramePair(frames[t], frames[t + 1], flow[t], np.isin(masks[t], moving)))
    return stack(pairs)
