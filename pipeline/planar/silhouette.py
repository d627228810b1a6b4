"""What a body's outlines and shading tell of its shape."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.motion.image_track import ImageTrack

ROUND_FILL = 0.88  # largest share of its smallest bounding rectangle that a disc fills (pi / 4; a rectangle: 1)
SHARPEST = 0.2  # quantile of that ratio over the frames that counts
ROUND_ASPECT = 1.45  # largest ratio of the sides of that rectangle: motion blur makes discs longer
SMOOTH = 0.5  # share of the brightness inside of a disc that a smooth function explains, from which it is a ball
INSIDE = 0.8  # squared radius of a disc, in its own, within which brightness counts
LEAST_RADIUS_PX = 4.0  # below it a disc's shading cannot be seen
LEAST_PIXELS = 12  # inside of it
FRAMES = 12  # looked at


@dataclass(frozen=True)
class Silhouette:
    """A body's outline over the clip.

    Attributes:
        round: It is a disc.
        width: px, the largest width of the outline (a disc's diameter), median over frames.
        height: px, across the direction of the largest width of a rectangle; a disc's diameter.
        angle: (T,) rad, of the rectangle's longer side from the picture's x axis towards its y axis, at the track's
            frames.
        ball: Share of the brightness inside of the disc that a quadratic of the place explains: 1 for a ball in plain
            light, near 0 for a flat face with marks; NaN where it cannot be seen.
    """

    round: bool
    width: float
    height: float
    angle: np.ndarray
    ball: float

    @property
    def shape(self) -> str:
        """The likeliest of sphere, cylinder (seen along its axis) and box."""
        if not self.round:
            return "box"
        return "cylinder" if self.ball < SMOOTH else "sphere"


def silhouette(track: ImageTrack, masks: np.ndarray, frames: np.ndarray) -> Silhouette:
    """The silhouette of a track's body.

    Args:
        track: Its track.
        masks: (T, H, W) ids of all frames.
        frames: (T, H, W, 3) uint8 RGB.
    """
    whole = np.flatnonzero(track.whole) if track.whole.any() else np.arange(len(track))
    chosen = whole[np.linspace(0, len(whole) - 1, min(FRAMES, len(whole))).round().astype(int)]
    boxes, fills, shading = [], [], []
    for k in chosen:
        frame = track.frames[k]
        rows, cols = np.nonzero(masks[frame] == track.body)
        _, sides, _ = cv2.minAreaRect(np.stack([cols, rows], 1).astype(np.float32))
        long, short = max(sides) + 1, min(sides) + 1
        boxes.append((long, short))
        fills.append(len(rows) / (long * short))
        if len(rows) >= np.pi * LEAST_RADIUS_PX**2:
            shading.append(smooth_share(frames[frame], rows, cols))
    width, height = np.median(boxes, axis=0)
    if np.median(fills) <= ROUND_FILL and np.quantile(np.divide(*np.transpose(boxes)), SHARPEST) <= ROUND_ASPECT:
        ball = float(np.nanmedian(shading)) if shading else float("nan")
        return Silhouette(True, 2 * track.radius, 2 * track.radius, track.angle, ball)
    return Silhouette(False, float(width), float(height), track.angle, float("nan"))


def smooth_share(frame: np.ndarray, rows: np.ndarray, cols: np.ndarray) -> float:
    """Share of the variance of the lightness inside of a disc that c + a x + b y + d (x² + y²) explains."""
    radius = np.sqrt(len(rows) / np.pi)
    x, y = (cols - cols.mean()) / radius, (rows - rows.mean()) / radius
    inside = x**2 + y**2 < INSIDE
    if inside.sum() < LEAST_PIXELS:
        return float("nan")
    x, y = x[inside], y[inside]
    colours = frame[rows[inside], cols[inside]][None]
    lightness = cv2.cvtColor(colours, cv2.COLOR_RGB2LAB)[0, :, 0].astype(float)
    matrix = np.stack([np.ones_like(x), x, y, x**2 + y**2], 1)
    residual = lightness - matrix @ np.linalg.lstsq(matrix, lightness, rcond=None)[0]
    return float(1 - residual.var() / max(lightness.var(), 1e-9))
