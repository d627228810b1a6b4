"""Errors of the centres that outlines have in masks.

The error of a centre depends on how the body lies on the grid of pixels. Where a body rests, all frames have the same
error, which their scatter does not show.
"""

from __future__ import annotations

import numpy as np

from pipeline.motion.image_track import centre_sigma

SAME_PLACE = 0.5  # px: centres so near to each other have the same error
MOST_AT_REST = 4  # frames of a body that rests that count
LEAST_MOVING = 6  # frames in which a body moves, from which they tell its error
SLOW_SIGMA = 0.1  # px: errors that change so slowly that neighbouring frames do not show them
USUAL_SIGMA = 0.15  # px, where too few frames tell


def centre_error(centre: np.ndarray) -> float:
    """Standard deviation, px, of each coordinate of a body's centres (T, 2), by the frames in which it moves."""
    moves = np.linalg.norm(np.diff(centre, axis=0), axis=1) > SAME_PLACE
    moving = np.append(moves, False) | np.insert(moves, 0, False)
    return float(np.hypot(centre_sigma(centre[moving]), SLOW_SIGMA)) if moving.sum() >= LEAST_MOVING else USUAL_SIGMA


def independent_frames(centre: np.ndarray) -> np.ndarray:
    """(T,) bool: all frames but most of those in which a body rests, of which MOST_AT_REST are kept.

    Args:
        centre: (T, 2) px, in the order of time.
    """
    kept = np.zeros(len(centre), bool)
    first = 0
    while first < len(centre):
        away = np.linalg.norm(centre[first:] - centre[first], axis=1) >= SAME_PLACE
        count = int(away.argmax()) if away.any() else len(away)
        kept[first + np.unique(np.linspace(0, count - 1, MOST_AT_REST).astype(int))] = True
        first += count
    return kept
