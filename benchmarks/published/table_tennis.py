"""Table-tennis balls with bounces, at nominally 10 ms, without time stamps
(github.com/intelligent-soft-robots/context, BSD-3).

The ratio of distance to speed between rows clusters at 5.5, 11 and 16.5 ms: every 10 ms the recorder took the latest
frame of cameras that run at 180 Hz. So the time between two rows is taken as the whole number of camera frames that
fits the distance and the speed in the file. A row that repeats the one before is the same frame and is left out.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from benchmarks.published.published_set import RealSet
from pipeline.discovery.tracks.track import Track

STEP = 1 / 180  # s
SPEEDS = 21  # rows whose median speed counts: single speeds are noisy, and up to five in a row are twice too large
BALL = {"name": "ball", "shape": "sphere", "radius": 0.02, "mass": 0.0027}


def read_table_tennis(folder: Path, most: int | None = None) -> RealSet:
    """All flights as one set, the first `most` of them. folder: real_motion/table_tennis."""
    tracks, low = [], []
    for path in sorted((folder / "trajectories").glob("*.json"))[:most]:
        rows = np.array(json.loads(path.read_text())["ob"], float)
        rows = rows[np.concatenate([[True], np.abs(np.diff(rows[:, :3], axis=0)).sum(1) > 0])]
        position, velocity = rows[:, :3], rows[:, 3:]
        steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
        single = np.linalg.norm(velocity, axis=1)
        speed = median_filter((single[1:] + single[:-1]) / 2, SPEEDS)
        frames = np.clip(np.rint(steps / np.maximum(speed * STEP, 1e-6)), 1, 40)
        time = np.concatenate([[0.0], np.cumsum(frames) * STEP])
        tracks.append(Track(path.stem, "ball", time, position))
        low.append(np.quantile(position[:, 2], 0.02))
    height = float(np.median(low)) - BALL["radius"]  # type: ignore[operator]
    return RealSet("table_tennis", tuple(tracks), {"ground": {"height": height}, "objects": [BALL]})
