"""An outline of known shape registered to a mask: its place and its size, whatever shadow or reflection hangs on it.

Points of the outline should be on the mask's border. Where a shadow belongs to the mask, they are inside of it: such
points lose their weight step by step, while points outside of the mask keep theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

MARGIN = 6  # px about a mask
WIDTHS = (4.0, 2.0, 1.2, 0.8, 0.8, 0.8)  # px, distances inside a mask at which a point's weight falls, one a step
SMALLEST, LARGEST = 0.4, 2.5  # scale
LEAST_SUPPORT = 0.35  # of the outline that must lie on the mask's border
MOST_OUTSIDE = 1.0  # px: larger distances outside of the mask count no more than so much


@dataclass(frozen=True)
class RegisteredOutline:
    """centre: (2,) px; scale: over the outline that was registered."""

    centre: np.ndarray
    scale: float


def register_outline(
    mask: np.ndarray, shape: np.ndarray, begin: tuple[np.ndarray, float] | None = None
) -> RegisteredOutline | None:
    """Register an outline to a mask; None where it fits too little of the mask's border.

    Args:
        mask: (H, W) bool.
        shape: (N, 2) px, the outline about its centre.
        begin: About where its centre is, (2,) px, and its scale, which is kept; None: both are found.
    """
    y, x = np.nonzero(mask)
    left, top = max(x.min() - MARGIN, 0), max(y.min() - MARGIN, 0)
    cut = mask[top : y.max() + MARGIN + 1, left : x.max() + MARGIN + 1].astype(np.uint8)
    cut = np.pad(cut, 1)
    inside = cv2.distanceTransform(cut, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    outside = cv2.distanceTransform(1 - cut, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance = np.where(cut > 0, 0.5 - inside, outside - 0.5).astype(np.float32)  # px, positive outside of the mask
    corner = np.array([left - 0.5, top - 0.5])  # less the padding; centres of pixels
    if begin is None:
        deep = np.unravel_index(int(inside.argmax()), inside.shape)
        centre = np.array([deep[1], deep[0]], float)
        inner = float(np.linalg.norm(shape, axis=1).min())
        scale = float(np.clip(inside.max() / max(inner, 1e-6), SMALLEST, LARGEST))
    else:
        centre, scale = begin[0] - corner, begin[1]
    support = 0.0
    for width in WIDTHS if begin is None else WIDTHS[1:]:
        for _ in range(2):
            points = centre + scale * shape
            off, slope = _sampled(distance, points)
            weight = np.where(off < 0, 1 / (1 + (off / width) ** 2) ** 2, 1.0)
            off = np.minimum(off, MOST_OUTSIDE)
            design = np.column_stack([slope, (slope * shape).sum(1) * (begin is None)])
            gram = (design * weight[:, None]).T @ design + np.diag([1e-6, 1e-6, 1e-6])
            change = -np.linalg.solve(gram, (design * weight[:, None]).T @ off)
            centre = centre + np.clip(change[:2], -2, 2)
            if begin is None:
                scale = float(np.clip(scale + np.clip(change[2], -0.1, 0.1), 0.3, 3.0))
        support = float((np.abs(off) < 1.0).mean())
    if support < LEAST_SUPPORT or not SMALLEST < scale < LARGEST:
        return None
    return RegisteredOutline(centre + corner, scale)


def _sampled(distance: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N,) px and their slopes (N, 2) at points (N, 2), by bilinear interpolation."""

    def at(shift: tuple[float, float]) -> np.ndarray:
        x, y = (np.ascontiguousarray((points[:, k] + shift[k])[None], np.float32) for k in (0, 1))
        return np.asarray(cv2.remap(distance, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0], float)

    slope = np.stack([at((0.5, 0)) - at((-0.5, 0)), at((0, 0.5)) - at((0, -0.5))], 1)
    return at((0, 0)), slope
