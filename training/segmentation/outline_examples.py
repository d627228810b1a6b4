"""Squares around bodies of the training clips, with their exact outlines, made once and kept.

    python -m training.segmentation.outline_examples CLIPS OUT [--each 10] [--seed 5]

CLIPS: of `training.segmentation.generate`. OUT: an .npz with the arrays of `OutlineExamples`.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from pipeline.bodies.networks.outline_network import SIDE
from pipeline.bodies.networks.outlines import LEAST_AREA_PX, Square, background, square_around
from training.segmentation.clip import UNSEEN, TrainingClip
from training.segmentation.kept_arrays import load_arrays

SHIFT, SCALE = 0.12, (0.8, 1.3)  # of a square's side: its place and size differ from those of the exact mask


@dataclass(frozen=True)
class OutlineExamples:
    """frame, plate: (N, SIDE, SIDE, 3) uint8. known, others, mask: (N, SIDE, SIDE) uint8, 255 where the background is
    known, where another body is, where the body is."""

    frame: np.ndarray
    plate: np.ndarray
    known: np.ndarray
    others: np.ndarray
    mask: np.ndarray


def jittered(rng: np.random.Generator, square: Square) -> Square:
    side = max(round(square.side * float(rng.uniform(*SCALE))), 8)
    x, y = rng.normal(0, SHIFT * square.side / 2, 2) + square.side / 2 - side / 2
    return Square(round(square.left + x), round(square.top + y), side)


def examples_of(rng: np.random.Generator, clip: TrainingClip, each: int) -> list[tuple[np.ndarray, ...]]:
    """At most `each` random bodies and frames of a clip, as the arrays of `OutlineExamples`."""
    seen = [
        (t, i + 1)
        for i in np.flatnonzero(clip.state != UNSEEN)
        for t in range(len(clip.frames))
        if (clip.mask[t] == i + 1).sum() >= LEAST_AREA_PX
    ]
    if not seen:
        return []
    reach = int(rng.integers(0, 3))
    grown = np.stack([cv2.dilate(m, np.ones((2 * reach + 1,) * 2, np.uint8)) for m in clip.mask])
    plate, known = background(clip.frames, grown)
    out = []
    for k in rng.permutation(len(seen))[:each]:
        t, body = seen[k]
        own = clip.mask[t] == body
        square = jittered(rng, square_around(own))
        others = (clip.mask[t] > 0) & ~own
        masks = [np.round(255 * square.cut(m)).astype(np.uint8) for m in (known, others, own)]
        out.append((square.cut(clip.frames[t]), square.cut(plate), *masks))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--each", type=int, default=10, help="examples of a clip, at most")
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    rows: list[tuple[np.ndarray, ...]] = []
    for index, path in enumerate(tqdm(sorted(arguments.clips.glob("*.npz")), disable=None)):
        rng = np.random.default_rng([arguments.seed, index])
        rows += examples_of(rng, load_arrays(path, TrainingClip), arguments.each)
    frame, plate, known, others, mask = (np.stack(column) for column in zip(*rows, strict=True))
    assert frame.shape[1:3] == (SIDE, SIDE)
    examples = OutlineExamples(frame=frame, plate=plate, known=known, others=others, mask=mask)
    np.savez(arguments.out, **asdict(examples))
    print(f"{len(frame)} examples in {arguments.out}")


if __name__ == "__main__":
    main()
