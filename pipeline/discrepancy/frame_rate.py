"""The rate at which a recording was sampled, and whether cameras run at it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.track import Track

#: Samples a second of common cameras and trackers; also those of NTSC, slower by 1000/1001.
STANDARD = np.array([24.0, 25, 30, 48, 50, 60, 90, 100, 120, 150, 180, 200, 240, 250, 300, 360, 480, 500, 960, 1000])
REGULAR = 0.002  # relative scatter of intervals that count as regular


def frame_rate(tracks: Sequence[Track]) -> float | None:
    """Samples a second, where intervals (but for missing rows) are all the same; else None."""
    steps = np.concatenate([np.diff(t.time) for t in tracks])
    step = float(np.median(steps))
    whole = steps / step
    near = np.abs(whole - np.rint(whole)) < 0.05
    if step <= 0 or near.mean() < 0.98:
        return None
    step = float(np.median(steps[near] / np.rint(whole[near]).clip(1)))
    scatter = float(np.median(np.abs(steps[near] / np.rint(whole[near]).clip(1) - step))) / step
    return 1 / step if scatter < REGULAR else None


def is_standard(rate: float, tolerance: float) -> bool:
    """Whether a rate is within a relative tolerance of a standard one."""
    every = np.concatenate([STANDARD, STANDARD * 1000 / 1001])
    return bool((np.abs(rate / every - 1) < tolerance).any())
