"""Masks of moving bodies: the network beside the classical way, by video IoU.

    python -m benchmarks.masks [--weights models/masks] [--seed N] [--sampled 100] [--sets cross_engine sampled real]
                               [--sam2 FOLDER] [--edgetam FOLDER]

Sets: the clips of another engine and real clips with outlines in benchmarks/outlines, both in DYNAMICS_DATA or
../shared/data (skipped where there are none), and fresh sampled clips by MuJoCo's renderer. Video IoU of each moving
body: predicted bodies are assigned to true ones once per clip by summed IoU, a body without a partner counts 0. Extra
bodies are those without a partner among the moving bodies, less those that lie on a true body that rests.
"""

from __future__ import annotations

import argparse
import secrets
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.mask_clips import OUTLINES, MaskClip, another_engine, outlined, sampled_by_mujoco
from benchmarks.motion_masks import masks_from_motion
from pipeline.bodies.found_bodies import moving_masks
from pipeline.bodies.networks import load_mask_networks
from pipeline.bodies.networks.propagation import body_prompts, segment_with
from pipeline.bodies.networks.published_models import FAMILIES, load_published
from pipeline.clips.overlap import assign, count, pair_iou
from pipeline.errors import VideoError
from pipeline.vision.flow.dis import DIS
from training.data_folder import data_folder

Finder = Callable[[MaskClip], np.ndarray]
RESTING_IOU = 0.3  # with a true body that rests: then a predicted body is not an extra one


@dataclass(frozen=True)
class Result:
    """iou: (M,) of each moving body. extra: predicted bodies that are none. seconds: for the clip's masks."""

    iou: np.ndarray
    extra: int
    seconds: float


def classical(clip: MaskClip) -> np.ndarray:
    try:
        return masks_from_motion(clip.frames, DIS("medium").flow(clip.frames[:-1], clip.frames[1:]))
    except VideoError:
        return np.zeros(clip.frames.shape[:3], np.uint8)


def published(family: str, folder: Path, find: Finder) -> Finder:
    """SAM 2 or EdgeTAM, prompted with the masks of another finder."""
    segmenter = load_published(family, folder)
    return lambda clip: segment_with(segmenter, clip.frames, body_prompts(find(clip)))


def score(predicted: np.ndarray, clip: MaskClip) -> tuple[np.ndarray, int]:
    """IoU (M,) of each moving body of a clip, and the number of extra bodies, of predicted ids (F, H, W) of the
    labelled frames."""
    found, true = int(predicted.max(initial=0)), int(clip.masks.max(initial=0))
    if found == 0 or not clip.moving:
        return np.zeros(len(clip.moving)), found
    iou = pair_iou(count(predicted, clip.masks, found, true))  # (F, found, true)
    # The mean over the frames in which either is seen; NaN where neither ever is.
    mean = np.nansum(iou, axis=0) / np.maximum((~np.isnan(iou)).sum(0), 1)
    moving = np.array(clip.moving) - 1
    pairs = assign(iou[:, :, moving])
    out = np.zeros(len(moving))
    for i, j in pairs:
        out[j] = mean[i, moving[j]]
    matched = {int(i) for i, j in pairs if out[j] > 0}
    resting = np.setdiff1d(np.arange(true), moving)
    seen = [i for i in range(found) if (predicted == i + 1).any() and i not in matched]
    return out, sum(1 for i in seen if not len(resting) or mean[i, resting].max() < RESTING_IOU)


def measure(clip: MaskClip, finder: Finder) -> Result:
    start = time.perf_counter()
    masks = finder(clip)
    seconds = time.perf_counter() - start
    return Result(*score(masks[clip.labelled], clip), seconds)


def report(name: str, clips: Iterator[MaskClip], finders: dict[str, Finder], each: bool) -> None:
    """Print a set's figures, one row a finder; each: one row a clip too."""
    results: dict[str, list[Result]] = {label: [] for label in finders}
    bodies = total = 0
    for clip in clips:
        total, bodies = total + 1, bodies + len(clip.moving)
        for label, finder in finders.items():
            results[label].append(measure(clip, finder))
        if each:
            shown = "   ".join(
                f"{k} {np.mean(v[-1].iou) if len(v[-1].iou) else np.nan:.3f} +{v[-1].extra}" for k, v in results.items()
            )
            print(f"  {clip.name:45} {len(clip.moving)} moving   {shown}", flush=True)
    if not total:
        print(f"\n{name}: skipped, no clips")
        return
    print(f"\n{name}: {total} clips, {bodies} moving bodies")
    for label, rows in results.items():
        iou = np.concatenate([r.iou for r in rows])
        by_clip = [r.iou.mean() for r in rows if len(r.iou)]
        print(
            f"  {label:10} video IoU a body {iou.mean():.3f}, a clip {np.mean(by_clip):.3f} (least {min(by_clip):.2f}, "
            f"{np.mean(np.array(by_clip) >= 0.6):.0%} of clips from 0.6)   extra bodies a clip "
            f"{np.mean([r.extra for r in rows]):.2f}   {np.mean([r.seconds for r in rows]):.2f} s a clip",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", type=Path, default=Path("models/masks"))
    parser.add_argument("--seed", type=int, default=None, help="of the sampled clips; a fresh one by default")
    parser.add_argument("--sampled", type=int, default=100, help="number of sampled clips")
    parser.add_argument("--sets", nargs="*", default=["cross_engine", "sampled", "real"])
    parser.add_argument("--outlines", type=Path, default=OUTLINES)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--each", action="store_true", help="print each clip")
    parser.add_argument("--no-classical", action="store_true")
    parser.add_argument("--plain", action="store_true", help="also without the network for outlines")
    for family in FAMILIES:
        parser.add_argument(f"--{family}", type=Path, help="folder of its weights; its row is left out without one")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    networks = load_mask_networks(arguments.weights)
    finders: dict[str, Finder] = {"network": lambda clip: moving_masks(clip.frames, clip.times, networks)}
    if arguments.plain:
        plain = replace(networks, outlines=None)
        finders["plain"] = lambda clip: moving_masks(clip.frames, clip.times, plain)
    if not arguments.no_classical:
        finders["classical"] = classical
    for family in FAMILIES:
        if folder := getattr(arguments, family):
            finders[family] = published(family, folder, finders["network"])
    print(f"seed {seed}, weights {arguments.weights}, {arguments.threads} threads")
    sources: dict[str, tuple[str, Iterator[MaskClip]]] = {
        "cross_engine": ("another engine's clips", another_engine(data_folder() / "cross_engine")),
        "sampled": ("fresh sampled clips by MuJoCo's renderer", sampled_by_mujoco(seed, arguments.sampled)),
        "real": ("real clips with outlines", outlined(arguments.outlines, data_folder() / "real_video")),
    }
    for name in arguments.sets:
        report(*sources[name], finders, arguments.each)


if __name__ == "__main__":
    main()
