"""What flow is scored on: held-out rendered pairs, and clips of another engine; and the scores.

The end-point error is the mean length of the difference to the exact flow over foreground pixels, which are those of
moving bodies in the first frame, all pairs' pixels together; px of the pictures as they are (240x160 for the rendered
pairs, 360x240 for the other engine's).
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.vision.recordings.video import read_clip
from training.clip_motions import ClipMotions
from training.flow_pairs import Pair, project_pair
from training.pair_stream import RENDER_SIZE, Batch, stack

HELD_OUT_PAIRS = 200
MOVING_PX = 0.05  # mean flow of a body's pixels, above which it counts as moving, where only the flow is known


class Estimator(Protocol):
    def flow(self, frames_a: np.ndarray, frames_b: np.ndarray, iterations: int = ...) -> np.ndarray: ...


@dataclass(frozen=True)
class Score:
    """Mean end-point errors, px, and time, s a pair."""

    foreground: float
    frame: float
    seconds: float


def held_out(seed: int, count: int = HELD_OUT_PAIRS, mujoco: bool = False) -> Batch:
    """One pair of neighbouring frames, with something moving in view, of each of so many clips as the project draws,
    simulates and renders them; the same for the same seed."""
    rng = np.random.default_rng(seed)
    motions = ClipMotions(seed, pairs=1)
    pairs: list[Pair] = []
    while len(pairs) < count:
        pair = project_pair(rng, motions.draw(rng), *RENDER_SIZE, mujoco)
        if pair.foreground.any():
            pairs.append(pair)
    return stack(pairs)


def score(estimator: Estimator, batch: Batch, iterations: int) -> Score:
    start = time.perf_counter()
    flow = estimator.flow(batch.frames_a, batch.frames_b, iterations)
    seconds = (time.perf_counter() - start) / len(flow)
    error = np.linalg.norm(flow - batch.flow_px, axis=-1)
    return Score(float(error[batch.foreground].mean()), float(error.mean()), seconds)


def cross_engine_folder() -> Path | None:
    """The folder of clips made by Blender and Bullet: in DYNAMICS_DATA, else beside the repository, else None."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("DYNAMICS_DATA", beside)) / "cross_engine"
    return folder if folder.is_dir() else None


def cross_engine(folder: Path, every: int = 4) -> Batch:
    """Every so many-th pair of each clip, in the clips' own size."""
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
                pairs.append(Pair(frames[t], frames[t + 1], flow[t], np.isin(masks[t], moving)))
    return stack(pairs)
