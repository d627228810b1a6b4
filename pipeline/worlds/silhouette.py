"""What a body's outlines and shading tell of its shape."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack

ROUND_FILL = 0.88  # largest share of its smallest bounding rectangle that a disc fills (pi / 4; a rectangle: 1)
SHARPEST = 0.2  # quantile of that ratio over the frames that counts
ROUND_ASPECT = 1.45  # largest ratio of the sides of that rectangle: motion blur makes discs longer
SMOOTH = 0.5  # share of the brightness inside of a disc that a smooth function explains, from which it is a ball
INSIDE = 0.8  # squared radius of a disc, in its own, within which brightness counts
LEAST_ELLIPSE, LEAST_SHAPED_PX = 0.93, 10.0  # overlap of a disc with its ellipse; radius, px, from which it tells
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
        ellipse: Intersection over union of the outline and the ellipse with its second moments, median over frames.
    """

    round: bool
    width: float
    height: float
    angle: np.ndarray
    ball: float
    ellipse: float

    @property
    def disc(self) -> bool:
        """Whether the outline is sure to be that of a disc, perhaps blurred, and not of a box on its corner."""
        return self.round and (self.ellipse > LEAST_ELLIPSE or self.width < 2 * LEAST_SHAPED_PX)

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
    boxes, fills, shading, ellipses = [], [], [], []
    for k in chosen:
        frame = track.frames[k]
        rows, cols = np.nonzero(masks[frame] == track.body)
        _, sides, _ = cv2.minAreaRect(np.stack([cols, rows], 1).astype(np.float32))
        long, short = max(sides) + 1, min(sides) + 1
        boxes.append((long, short))
        fills.append(len(rows) / (long * short))
        ellipses.append(ellipse_overlap(rows, cols))
        if len(rows) >= np.pi * LEAST_RADIUS_PX**2:
            shading.append(smooth_share(frames[frame], rows, cols))
    width, height = np.median(boxes, axis=0)
    if np.median(fills) <= ROUND_FILL and np.quantile(np.divide(*np.transpose(boxes)), SHARPEST) <= ROUND_ASPECT:
        ball = float(np.nanmedian(shading)) if shading else float("nan")
        return Silhouette(
            round=True,
            width=2 * track.radius,
            height=2 * track.radius,
            angle=track.angle,
            ball=ball,
            ellipse=float(np.median(ellipses)),
        )
    return Silhouette(
        round=False,
        width=float(width),
        height=float(height),
        angle=track.angle,
        ball=float("nan"),
        ellipse=float(np.median(ellipses)),
    )


def ellipse_overlap(rows: np.ndarray, cols: np.ndarray) -> float:
    """Intersection over union of pixels (M,) and the filled ellipse with their second moments."""
    places = np.stack([cols, rows], 1).astype(float)
    middle, spread = places.mean(0), np.cov(places.T) + np.eye(2) / 12
    low, high = places.min(0) - 2, places.max(0) + 3
    grid = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])), -1).reshape(-1, 2)
    off = grid - middle
    inside = np.einsum("ni,ij,nj->n", off, np.linalg.inv(spread), off) < 4
    own = np.isin(grid[:, 0] * 1e5 + grid[:, 1], places[:, 0] * 1e5 + places[:, 1])
    return float((inside & own).sum() / (inside | own).sum())


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
