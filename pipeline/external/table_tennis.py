"""Table-tennis balls with bounces, at nominally 10 ms, without time stamps
(github.com/intelligent-soft-robots/context, BSD-3).

The file's velocities tell which frames are missing: the time between two rows is what the distance between them takes.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pipeline.discrepancy.track import Track
from pipeline.external.place import RealSet

STEP = 0.01  # s
BALL = {"name": "ball", "shape": "sphere", "radius": 0.02, "mass": 0.0027}
SOURCE, LICENCE = "intelligent-soft-robots/context", "BSD-3-Clause"


def read_table_tennis(folder: Path, most: int | None = None) -> RealSet:
    """All flights as one set, the first `most` of them. folder: real_motion/table_tennis."""
    tracks, low = [], []
    for path in sorted((folder / "trajectories").glob("*.json"))[:most]:
        rows = np.array(json.loads(path.read_text())["ob"], float)
        position, velocity = rows[:, :3], rows[:, 3:]
        steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
        speed = np.linalg.norm(velocity[1:] + velocity[:-1], axis=1) / 2
        frames = np.clip(np.rint(steps / np.maximum(speed * STEP, 1e-6)), 1, 5)
        time = np.concatenate([[0.0], np.cumsum(frames) * STEP])
        tracks.append(Track(path.stem, "ball", time, position))
        low.append(np.quantile(position[:, 2], 0.02))
    height = float(np.median(low)) - BALL["radius"]  # type: ignore[operator]
    return RealSet("table_tennis", tuple(tracks), {"ground": {"height": height}, "objects": [BALL]}, SOURCE, LICENCE)
