"""End-point error of flow before and after what was not measured is filled in, and flicker on real clips.

    python -m benchmarks.supported_flow [--suites id held_out] [--render data/render] [--weights models/raft-small]

Suites: rendered clips of the graph (`make repro` makes them). Then another engine's clips and real videos, in
DYNAMICS_DATA or ../shared/data (skipped where there are none). Real clips have no exact flow: the share of their
background that moves by more than FLICKER_PX is printed, with the bodies that the network for masks finds, and the
mean difference of the two frames' colours on bodies, after the second is warped by the flow.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from pipeline.bodies.found_bodies import moving_masks
from pipeline.bodies.networks import load_mask_networks
from pipeline.clips.schedule import Schedule
from pipeline.errors import VideoError
from pipeline.shards.dataset import open_shards
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.flow_confidence import followed
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT, load_raft
from pipeline.vision.flow.supported_flow import supported_flow
from pipeline.vision.recordings.clip_folder import find_clips
from pipeline.vision.recordings.video import read_clip
from training.data_folder import data_folder

SIZE, ITERATIONS = (240, 160), 4
FLICKER_PX = 0.5
FAR_PX = 12  # from any body: background that neither shadows nor edges disturb
SCHEDULE = Schedule()


@dataclass(frozen=True)
class FlowClip:
    """frames (T, H, W, 3) and masks (T, H, W) uint8; exact: flow (P, H, W, 2) px of `SCHEDULE`'s pairs, or None."""

    name: str
    frames: np.ndarray
    masks: np.ndarray
    exact: np.ndarray | None


def rendered(folder: Path) -> Iterator[FlowClip]:
    for clip in open_shards(folder):
        yield FlowClip(f"{folder.name} {clip.index}", clip.array("rgb"), clip.array("mask"), clip.array("flow"))


def another_engine(folder: Path) -> Iterator[FlowClip]:
    for place in sorted(folder.glob("clip_*")):
        masks = np.load(place / "masks.npz")["masks"]
        flow = np.load(place / "flow_depth.npz")["flow_fwd"].astype(np.float32)
        size = (masks.shape[2], masks.shape[1])
        frames = read_clip(place / "video.mp4", seconds=len(masks) / 30, size=size).frames
        yield FlowClip(place.name, frames, masks, flow[SCHEDULE.pairs[:, 0]])


def real(folder: Path) -> Iterator[FlowClip]:
    networks = load_mask_networks("models/masks")
    for place in find_clips(folder):
        try:
            clip = read_clip(place, 0.0, SCHEDULE.seconds, size=(480, 320))
        except VideoError as error:
            print(f"  skipped: {error}")
            continue
        masks = moving_masks(clip.frames, clip.times, networks)
        if masks.any():
            yield FlowClip(place.stem, clip.frames, masks, None)


def flows(clip: FlowClip, estimators: dict[str, RAFT | DIS]) -> Iterator[tuple[str, np.ndarray]]:
    """Each estimator's flow of a clip, as it is and filled in."""
    recorded, interval, pairs = np.arange(len(clip.frames)) / SCHEDULE.fps, 1 / SCHEDULE.fps, SCHEDULE.pairs
    for label, estimator in estimators.items():
        flow = measured_flow(estimator, clip.frames, recorded, pairs, interval, ITERATIONS, SIZE)
        yield label, flow
        filled = supported_flow(flow, clip.frames, clip.masks, recorded, pairs, interval=interval, size=SIZE)
        yield f"{label} filled in", filled.flow


def figures(clip: FlowClip, flow: np.ndarray) -> np.ndarray:
    """Sums and counts: of the error on frame, background and bodies, of far background that moves, and of colours."""
    masks = clip.masks[SCHEDULE.pairs[:, 0]]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * FAR_PX + 1,) * 2)
    far = np.stack([cv2.dilate(np.uint8(m > 0), disc) == 0 for m in masks])
    moving = np.linalg.norm(flow, axis=-1) > FLICKER_PX
    out = [(moving[far].sum(), far.sum())]
    if clip.exact is not None:
        error = np.linalg.norm(flow - clip.exact, axis=-1)
        out += [(error[part].sum(), part.sum()) for part in (masks >= 0, masks == 0, masks > 0)]
    else:
        first, second = (clip.frames[SCHEDULE.pairs[:, k]].astype(np.float32) for k in (0, 1))
        change = np.stack([np.abs(followed(b, f) - a).mean(-1) for a, b, f in zip(first, second, flow, strict=True)])
        out += [(change[masks > 0].sum(), (masks > 0).sum())]
    return np.array(out, float)


def report(name: str, clips: Iterator[FlowClip], estimators: dict[str, RAFT | DIS]) -> None:
    sums: dict[str, list[np.ndarray]] = {}
    for clip in clips:
        for label, flow in flows(clip, estimators):
            sums.setdefault(label, []).append(figures(clip, flow))
    print(f"\n{name}: {len(next(iter(sums.values()), []))} clips")
    for label, rows in sums.items():
        shares = [row[:, 0] / np.maximum(row[:, 1], 1) for row in rows]
        if len(rows[0]) == 2:
            flicker, change = np.mean(shares, 0)
            print(f"  {label:16} far background moves {flicker:6.1%}   colours on bodies differ by {change:5.2f}")
            continue
        flicker, frame, background, bodies = np.sum(rows, 0)[:, 0] / np.sum(rows, 0)[:, 1]
        print(
            f"  {label:16} error on frame {frame:.3f} px, background {background:.3f}, bodies {bodies:.3f}   "
            f"far background moves {flicker:6.1%}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", nargs="*", default=["id", "held_out"])
    parser.add_argument("--render", type=Path, default=Path("data/render"))
    parser.add_argument("--weights", type=Path, default=Path("models/raft-small"))
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    estimators: dict[str, RAFT | DIS] = {"RAFT": load_raft(arguments.weights), "DIS": DIS("medium")}
    for suite in arguments.suites:
        report(f"suite {suite}", rendered(arguments.render / suite), estimators)
    report("another engine's clips", another_engine(data_folder() / "cross_engine"), estimators)
    videos = data_folder() / "real_video"
    report("real clips with bodies", real(videos) if videos.is_dir() else iter(()), estimators)


if __name__ == "__main__":
    main()
