"""The convex hull of a mask."""

from __future__ import annotations

import cv2
import numpy as np


def convex_hull(mask: np.ndarray) -> np.ndarray:
    """The convex hull of a mask (H, W) bool, as another."""
    filled = np.zeros(mask.shape, np.uint8)
    points = cv2.findNonZero(mask.astype(np.uint8))
    if points is not None:
        cv2.fillConvexPoly(filled, cv2.convexHull(points), 1)
    return filled > 0
