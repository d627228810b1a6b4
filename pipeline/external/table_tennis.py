"""Table-tennis balls with bounces, at nominally 10 ms, without time stamps
(github.com/intelligent-soft-robots/context, BSD-3).

Rows are 5, 10 or more ms apart (the distances between them say so): the time between two rows is taken as the multiple
of 5 ms that the distance takes at the speed that the file gives.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from pipeline.discrepancy.track import Track
from pipeline.external.place import RealSet

STEP = 0.005  # s
BALL = {"name": "ball", "shape": "sphere", "radius": 0.02, "mass": 0.0027}
SOURCE, LICENCE = "intelligent-soft-robots/context", "BSD-3-Clause"


def read_table_tennis(folder: Path, most: int | None = None) -> RealSet:
    """All flights as one set, the first `most` of them. folder: real_motion/table_tennis."""
    tracks, low = [], []
    for path in sorted((folder / "trajectories").glob("*.json"))[:most]:
        rows = np.array(json.loads(path.read_text())["ob"], float)
        position, velocity = rows[:, :3], rows[:, 3:]
        steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
        single = np.linalg.norm(velocity, axis=1)
        speed = median_filter((single[1:] + single[:-1]) / 2, 5)  # single velocities are noisy
        frames = np.clip(np.rint(steps / np.maximum(speed * STEP, 1e-6)), 1, 40)
        time = np.concatenate([[0.0], np.cumsum(frames) * STEP])
        tracks.append(Track(path.stem, "ball", time, position))
        low.append(np.quantile(position[:, 2], 0.02))
    height = float(np.median(low)) - BALL["radius"]  # type: ignore[operator]
    return RealSet("table_tennis", tuple(tracks), {"ground": {"height": height}, "objects": [BALL]}, SOURCE, LICENCE)
