"""Workers that make training examples: views of motions with their answers, in files for the trainer beside them.

    python -m training.words.examples MOTIONS OUT --worker 0 --seconds 700

A file holds CHUNK views as arrays KIND.N.NAME: KIND is what is shown, N the number of bodies in the prompt (0 for whole
frames). Each view has ANSWERS answers: other orders and places of the bodies, with or without `<think>`.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch

from pipeline.model import decisions as d
from pipeline.model.instances import HEIGHT, WIDTH
from pipeline.model.shown import FRAME_SIZE, SeenBodies, flow_frames, rgb_crops, rgb_frames
from pipeline.model.words_example import Arrays, bodies_example, frames_example, stacked, truth_of
from training.words.motions import Motion, read_motions
from training.words.views import (
    Fields,
    MotionView,
    boxes_wanted,
    draw_view,
    instances_with_errors,
    motion_labels,
    noisy,
    pictures,
    shown_rgb,
)

CHUNK = 96
ANSWERS = 3
#: Kinds of example and their shares of what is made; colours take longest and are shown more often each.
SHARES = {"flow": 0.82, "rgb": 0.06, "frame_flow": 0.1, "frame_rgb": 0.02}
WITHOUT_THINK = 0.25
SECONDS = 1.0  # of a clip


def example(view: MotionView, kind: str, fields: Fields, rng: np.random.Generator) -> tuple[int, Arrays] | None:
    """Number of bodies in the prompt (0: whole frames) and the arrays of an example; None where no body is seen."""
    truth = truth_of(view.scene, motion_labels(view), view.events, SECONDS)
    reasons = (rng.random(ANSWERS) >= WITHOUT_THINK).tolist()
    if kind == "frame_rgb":
        return 0, frames_example(rgb_frames(shown_rgb(view, rng, None, *FRAME_SIZE)), truth, reasons)
    exact = pictures(view)
    if kind == "frame_flow":
        flow = noisy(exact.flow, exact.masks, exact.within, fields, rng)
        return 0, frames_example(flow_frames(flow), truth, reasons)
    instances = instances_with_errors(exact, len(truth.shapes), fields, rng)
    if not 0 < len(instances) <= d.PLACES:
        return None
    colours = None
    if kind == "rgb":
        frames = shown_rgb(view, rng, boxes_wanted(instances.places), WIDTH, HEIGHT)
        colours = rgb_crops(frames, instances.places)
    return len(instances), bodies_example(SeenBodies(instances, colours), truth, reasons, rng)


def chunks(
    motions: Iterator[Motion], rng: np.random.Generator, shares: dict[str, float], size: int = CHUNK
) -> Iterator[Arrays]:
    """Arrays KIND.N.NAME of `size` views at a time."""
    fields = Fields()
    kinds = list(shares)
    share = np.array(list(shares.values()))
    groups: dict[str, list[Arrays]] = defaultdict(list)
    made = 0
    for motion in motions:
        view = draw_view(motion, rng)
        if view is None:
            continue
        kind = kinds[rng.choice(len(kinds), p=share / share.sum())]
        found = example(view, kind, fields, rng)
        if found is None:
            continue
        groups[f"{kind}.{found[0]}"].append(found[1])
        made += 1
        if made == size:
            yield _named(groups)
            groups.clear()
            made = 0


def _named(groups: dict[str, list[Arrays]]) -> Arrays:
    return {f"{key}.{name}": v for key, rows in groups.items() for name, v in stacked(rows).items()}


def shuffled(folder: Path, rng: np.random.Generator) -> Iterator[Motion]:
    """Motions of the folder's files without end, files and motions in random order."""
    while True:
        for path in rng.permutation(sorted(folder.glob("[0-9]*.npz"))):
            motions = read_motions(path)
            for k in rng.permutation(len(motions)):
                yield motions[k]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motions", type=Path, help="folder of `training.words.motions`")
    parser.add_argument("out", type=Path, help="folder of the files")
    parser.add_argument("--worker", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--files", type=int, help="stop after so many")
    parser.add_argument("--ahead", type=int, default=400, help="wait while so many files lie there unread")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shares", type=json.loads, default=SHARES, help="JSON of the kinds' shares")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    asked.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng((asked.seed, asked.worker))
    end, began = time.time() + asked.seconds, time.time()
    for k, arrays in enumerate(chunks(shuffled(asked.motions, rng), rng, asked.shares)):
        part = asked.out / f".{asked.worker}.npz"
        np.savez(part, **arrays)  # type: ignore[arg-type]
        os.replace(part, asked.out / f"{k:06d}-{asked.worker:02d}.npz")
        if k % 20 == 0:
            print(f"worker {asked.worker}: {(k + 1) * CHUNK / (time.time() - began):.0f} views/s", flush=True)
        if time.time() > end or k + 1 == asked.files:
            return
        while len(os.listdir(asked.out)) > asked.ahead and time.time() < end:
            time.sleep(0.2)


if __name__ == "__main__":
    main()
