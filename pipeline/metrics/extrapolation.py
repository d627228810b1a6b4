"""Forecasts of masks without physics, beside which those of a scene are judged."""

from __future__ import annotations

import numpy as np

TRACK_SECONDS = 0.2  # before the last frame seen, over which an instance's velocity is measured


def at_constant_velocity(masks: np.ndarray, more: int, fps: float) -> np.ndarray:
    """The `more` frames (more, H, W) after masks (F, H, W): each instance's last mask, at its centroid's velocity.

    The velocity, px, is fitted over `TRACK_SECONDS`. Where two instances meet, the higher number is in front.
    """
    out = np.zeros((more, *masks.shape[1:]), np.uint8)
    steps = max(2, round(TRACK_SECONDS * fps) + 1)
    for instance in range(1, int(masks.max(initial=0)) + 1):
        frames = [k for k in range(len(masks)) if (masks[k] == instance).any()]
        if not frames:
            continue
        recent = [k for k in frames if k > frames[-1] - steps]
        places = np.array([np.argwhere(masks[k] == instance).mean(0) for k in recent])  # (T, 2) row, column
        velocity = np.polyfit(recent, places, 1)[0] if len(recent) > 1 else np.zeros(2)
        last = np.argwhere(masks[frames[-1]] == instance)
        for k in range(more):
            shift = velocity * (len(masks) + k - frames[-1])
            rows, columns = np.rint(last + shift).astype(int).T
            inside = (rows >= 0) & (rows < masks.shape[1]) & (columns >= 0) & (columns < masks.shape[2])
            out[k, rows[inside], columns[inside]] = instance
    return out
