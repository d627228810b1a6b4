"""Errors of the centres that outlines have in masks.

The error of a centre depends on how the body lies on the grid of pixels. Where a body rests, all frames have the same
error, which their scatter does not show.
"""

from __future__ import annotations

import numpy as np

from pipeline.bodies.tracks.image_track import LEAST_CENTRES, centre_sigma
from pipeline.worlds.arcs import LEAST_SIGMA

SAME_PLACE = 0.5  # px: centres so near to each other have the same error
MOST_AT_REST = 4  # frames that are kept of each rest
USUAL_SIGMA = 0.15  # px, where the body moves in too few frames to estimate its error


def centre_error(centre: np.ndarray) -> float:
    """Standard deviation, px, of each coordinate of a body's centres (T, 2) px, from the frames in which it moves.

    LEAST_SIGMA stands for errors that change so slowly that neighbouring frames do not show them.
    """
    moves = np.linalg.norm(np.diff(centre, axis=0), axis=1) > SAME_PLACE
    moving = np.append(moves, False) | np.insert(moves, 0, False)
    return float(np.hypot(centre_sigma(centre[moving]), LEAST_SIGMA)) if moving.sum() >= LEAST_CENTRES else USUAL_SIGMA


def independent_frames(centre: np.ndarray) -> np.ndarray:
    """The frames whose errors are nearly independent: those in which a body moves, and MOST_AT_REST of each rest.

    Args:
        centre: (T, 2) px, in the order of time.

    Returns:
        (T,) bool.
    """
    kept = np.zeros(len(centre), bool)
    first = 0
    while first < len(centre):
        away = np.linalg.norm(centre[first:] - centre[first], axis=1) >= SAME_PLACE
        count = int(away.argmax()) if away.any() else len(away)
        kept[first + np.unique(np.linspace(0, count - 1, MOST_AT_REST).astype(int))] = True
        first += count
    return kept
