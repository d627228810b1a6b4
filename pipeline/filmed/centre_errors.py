"""Errors of the centres that outlines have in masks."""

from __future__ import annotations

import numpy as np

from pipeline.motion.image_track import centre_sigma

SAME_PLACE = 0.5  # px: centres so near to each other have the same error, that of one mask
LEAST_MOVING = 6  # frames that tell the error of a body that moves
LEAST_SIGMA, USUAL_SIGMA = 0.05, 0.15  # px; the usual one where too few frames tell


def centre_errors(centre: np.ndarray) -> np.ndarray:
    """Standard deviations of a body's centres, as of independent measurements.

    The error of a centre depends on how the body lies on the grid of pixels. Where a body rests, all frames have the
    same error, so that it cannot be seen in their scatter, and together they count as one measurement. So the error is
    told by the frames in which the body moves.

    Args:
        centre: (T, 2) px, in the order of time.

    Returns:
        (T,) px, of each coordinate.
    """
    steps = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    moves = np.append(steps > SAME_PLACE, False) | np.insert(steps > SAME_PLACE, 0, False)
    sigma = max(centre_sigma(centre[moves]), LEAST_SIGMA) if moves.sum() >= LEAST_MOVING else USUAL_SIGMA
    near = np.linalg.norm(centre[:, None] - centre[None], axis=-1) < SAME_PLACE
    return np.asarray(sigma * np.sqrt(near.sum(1)))
