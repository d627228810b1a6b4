"""Make training clips and keep them: rendered bodies with exact masks, and the network's features.

    python -m training.segmentation.generate OUT --first 0 --count 1000 [--seed 77] [--minutes 30] [--stride 1]

Clip i depends on the seed and i alone; a clip that is already there is skipped, so a run that was stopped goes on.
SHARES says how many clips are of the project's own sampler, as people film, of other solid bodies by MuJoCo's renderer
and by our ray caster, and of flat bodies.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from pipeline.bodies.networks.inputs import clip_features, steady_exposure
from pipeline.vision.rendering.render_backend import choose_backend
from training.segmentation.clip import UNSEEN, DrawnClip, TrainingClip, faint
from training.segmentation.filmed_clip import draw_filmed_clip
from training.segmentation.flat_clip import draw_flat_clip
from training.segmentation.kept_arrays import save_arrays
from training.segmentation.recording import letterboxed, recorded
from training.segmentation.sampled_clip import draw_sampled_clip
from training.segmentation.solid_clip import draw_solid_clip

SIZE = (240, 160)  # px, width and height
KINDS = ("sampled", "filmed", "mujoco", "raycast", "flat")
SHARES = (0.25, 0.25, 0.25, 0.1, 0.15)


def draw_clip(rng: np.random.Generator, kind: str) -> DrawnClip:
    """The first of the random clips of a kind that shows enough."""
    while True:
        if kind == "flat":
            drawn = draw_flat_clip(rng, *SIZE)
        elif kind == "sampled":
            drawn = draw_sampled_clip(rng, *SIZE)
        elif kind == "filmed":
            drawn = draw_filmed_clip(rng, *SIZE)
        else:
            drawn = draw_solid_clip(rng, *SIZE, mujoco=kind == "mujoco")
        if drawn is not None:
            return drawn


def make_clip(seed: int, index: int, kind: str | None = None) -> TrainingClip:
    """Training clip `index` of a seed: the same wherever it is made. kind: of KINDS; None: by chance."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, index)))
    drawn_kind = KINDS[int(rng.choice(len(KINDS), p=SHARES))]
    drawn = draw_clip(rng, kind or drawn_kind)
    frames, mask, other = drawn.frames, drawn.mask, drawn.other
    order = np.arange(len(frames))
    if rng.random() < 0.05:  # a frame shown twice now and then, as where frame rates are converted
        skip = int(rng.integers(2, 6))
        order[skip::skip] -= 1
    frames = frames[order] if drawn.recorded else recorded(rng, frames[order])
    mask, other = mask[order], other[order]
    if rng.random() < 0.12:
        pictures = letterboxed(rng, [frames, mask, other], float(rng.uniform(0.25, 0.75)))
        frames, mask, other = pictures
    frames = steady_exposure(frames)
    state = np.where(faint(frames, mask, len(drawn.state)), UNSEEN, drawn.state).astype(np.uint8)
    features = clip_features(frames)
    return TrainingClip(
        frames=frames,
        mask=mask,
        other=other,
        centre=drawn.centre[order].astype(np.float32),
        radius=drawn.radius[order].astype(np.float32),
        state=state,
        background=features.background,
        low=features.low,
        high=features.high,
        flicker=features.flicker,
        forward=features.forward,
        backward=features.backward,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--stride", type=int, default=1, help="make every n-th clip only, to share the work")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--kind", choices=KINDS, help="of all clips; by chance if it is not given")
    parser.add_argument("--minutes", type=float, default=1e9)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    choose_backend("auto")
    arguments.out.mkdir(parents=True, exist_ok=True)
    start, made = time.monotonic(), 0
    for index in range(arguments.first, arguments.first + arguments.count, arguments.stride):
        path = arguments.out / f"{index:06d}.npz"
        if path.exists():
            continue
        save_arrays(path, make_clip(arguments.seed, index, arguments.kind))
        made += 1
        spent = time.monotonic() - start
        if made % 20 == 0:
            print(f"{made} clips, {spent / made:.2f} s a clip, at {index}", flush=True)
        if spent > 60 * arguments.minutes:
            break


if __name__ == "__main__":
    main()
