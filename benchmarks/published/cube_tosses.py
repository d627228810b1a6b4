"""Tosses of an acrylic cube with orientations at 148 Hz (github.com/DAIRLab/contact-nets, BSD-3).

Lengths are in half sides of the cube, and were smoothed. The ground is at the lowest corners of the resting cube.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.published.published_set import RealSet
from pipeline.discovery.tracks.track import Track
from pipeline.scene.rotation import matrix_from_quaternion

HALF_SIDE, MASS, STEP = 0.0524, 0.37, 1 / 148


def read_cube_tosses(folder: Path, most: int | None = None) -> RealSet:
    """The first `most` tosses. folder: real_motion/cube_tosses."""
    import torch

    tracks, rest = [], []
    paths = sorted((folder / "data" / "tosses_processed").glob("*.pt"), key=lambda p: int(p.stem))[:most]
    for path in paths:
        rows = torch.load(path, weights_only=True)[0].numpy().astype(float)
        position, quaternion = rows[:, :3] * HALF_SIDE, rows[:, 3:7]
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
        reach = HALF_SIDE * np.abs(matrix_from_quaternion(quaternion)[:, 2]).sum(1)
        rest.append(float((position[:, 2] - reach).min()))
        tracks.append(Track(f"toss_{int(path.stem):03d}", "cube", np.arange(len(rows)) * STEP, position, quaternion))
    side = 2 * HALF_SIDE
    cube = {"name": "cube", "shape": "box", "width": side, "depth": side, "height": side, "mass": MASS}
    known = {"ground": {"height": float(np.median(rest))}, "objects": [cube]}
    return RealSet("cube_tosses", tuple(tracks), known)
