"""The camera's roll, from the level and upright edges of what stands still (walls, tiles, shelves)."""

from __future__ import annotations

import cv2
import numpy as np

WITHIN_DEG = 10.0  # of the picture's own vertical and horizontal
WIDTH_DEG = 0.5  # of the peak of directions
LEAST_LINE = 0.04  # of the picture's longer side, length of a line that counts
LEAST_LINES, LEAST_TOTAL, LEAST_SHARE = 3, 0.8, 0.6  # upright lines; length over the picture's height; in one peak
AGREE_DEG = 2.0  # between upright and level lines
GRID_DEG = np.linspace(-WITHIN_DEG, WITHIN_DEG, 201)


def camera_roll(background: np.ndarray) -> float | None:
    """The angle, deg, by which the world's vertical is turned in the picture, clockwise; None where too few lines tell.

    background: (H, W, 3) uint8 RGB, without what moves.
    """
    grey = cv2.cvtColor(background, cv2.COLOR_RGB2GRAY)
    height, width = grey.shape
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    if lines is None:
        return None
    ways = lines.reshape(-1, 4)[:, 2:] - lines.reshape(-1, 4)[:, :2]
    lengths = np.hypot(*ways.T)
    long = lengths > LEAST_LINE * max(width, height)
    angles, lengths = np.degrees(np.arctan2(ways[long, 1], ways[long, 0])), lengths[long]
    upright = _peak(angles - 90, lengths)
    if upright is None or upright[1] < LEAST_LINES or upright[2] < LEAST_TOTAL * height or upright[3] < LEAST_SHARE:
        return None
    level = _peak(angles, lengths)
    if level is None or level[1] < LEAST_LINES or abs(level[0] - upright[0]) > AGREE_DEG:
        return upright[0]
    return 0.5 * (upright[0] + level[0])


def _peak(angles: np.ndarray, lengths: np.ndarray) -> tuple[float, int, float, float] | None:
    """The commonest direction of lines near 0 deg; None where there are none.

    Returns its angle, the number of lines near 0, their length, and the share of that length in the peak.
    """
    off = (angles + 90) % 180 - 90
    near = np.abs(off) < WITHIN_DEG
    if not near.any():
        return None
    off, lengths = off[near], lengths[near]
    heights = (lengths * np.exp(-0.5 * ((off - GRID_DEG[:, None]) / WIDTH_DEG) ** 2)).sum(1)
    best = int(np.argmax(heights))
    return float(GRID_DEG[best]), len(off), float(lengths.sum()), float(heights[best] / lengths.sum())
