"""Forecasts of masks: as a replay moves, and, for comparison, at constant velocity."""

from __future__ import annotations

import cv2
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


def moved_with_replay(own: np.ndarray, masks: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """The frames after `masks`: each instance's last mask, moved and scaled as its object's mask in the replay.

    Args:
        own: (F + M, H, W) the replay's masks.
        masks: (F, H, W) masks of the seen frames.
        pairs: (P, 2) object, instance.

    Returns:
        (M, H, W). Where instance and object are not both visible in the last frame seen: the object's own mask.
    """
    last, later = len(masks) - 1, own[len(masks) :]
    out = np.zeros_like(later)
    for i, j in pairs:
        shape = masks[last] == j + 1
        before, true = _centre_and_size(own[last] == i + 1), _centre_and_size(shape)
        for frame, mask in zip(out, later == i + 1, strict=True):
            now = _centre_and_size(mask)
            if before is None or true is None or now is None:
                frame[mask] = j + 1
                continue
            scale = now[1] / before[1]
            shift = true[0] + now[0] - before[0] - scale * true[0]
            matrix = np.column_stack([scale * np.eye(2), shift])
            moved = cv2.warpAffine(shape.astype(np.uint8), matrix, shape.shape[::-1], flags=cv2.INTER_NEAREST)
            frame[moved > 0] = j + 1
    return out


def _centre_and_size(mask: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Centroid (2,) column, row of a mask (H, W) and the square root of its area, px; None where it is empty."""
    rows, columns = np.nonzero(mask)
    return (np.array([columns.mean(), rows.mean()]), float(np.sqrt(len(rows)))) if len(rows) else None
