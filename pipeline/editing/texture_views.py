"""The texture of a body as the frames nearest to its pose show it, so that highlights and reflections stay sharp.

The mean of all frames loses what depends on where a body is and how it is turned. So each picture takes a texel
foremost from the frames in which the body was turned alike, seen in the same place and at about the same time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.compiled import kernel
from pipeline.editing.surface_texture import SeenTexels

ANGLE_DEG, PLACE_DEG, FRAMES = 10.0, 3.0, 2.0  # standard deviations of what counts as near: turn, place, time
PRIOR = 0.02  # weight of the mean of all frames


@dataclass(frozen=True)
class Pose:
    """Where and how a body is shown.

    Attributes:
        quaternion: (..., 4) wxyz, as the texture turns with it.
        place_px: (..., 2), its centre in the picture.
        frame: (...), of the clip.
    """

    quaternion: np.ndarray
    place_px: np.ndarray
    frame: np.ndarray


def nearness(seen: Pose, pose: Pose, focal: float) -> np.ndarray:
    """(K,) how near K poses in which a body was seen are to one of it: 1 for the nearest of them. focal: px."""
    cosine = np.abs(seen.quaternion @ pose.quaternion).clip(0, 1)
    turn = np.degrees(2 * np.arccos(cosine)) / ANGLE_DEG
    place = np.linalg.norm(seen.place_px - pose.place_px, axis=-1) / (focal * math.tan(math.radians(PLACE_DEG)))
    squared = turn**2 + place**2 + ((seen.frame - pose.frame) / FRAMES) ** 2
    return np.asarray(np.exp(-0.5 * (squared - squared.min(initial=np.inf))))


def texture_near(mean: np.ndarray, seen: SeenTexels, near: np.ndarray) -> np.ndarray:
    """A texture (6, S, S, 3) float32 for a pose, from the mean of all frames and those near to it, `near` (K,)."""
    out = np.ascontiguousarray(mean, np.float32).reshape(-1, 3).copy()
    _blend(seen.colour, seen.weight, np.ascontiguousarray(near, np.float32), out)
    return out.reshape(mean.shape)


@kernel
def _blend(colour: np.ndarray, weight: np.ndarray, near: np.ndarray, out: np.ndarray) -> None:
    """Blend (K, M, 3) colours, with weights (K, M) and shares (K,), into `out` (M, 3), which has the weight PRIOR."""
    total = np.full(out.shape[0], np.float32(PRIOR))
    out *= np.float32(PRIOR)
    for k in range(len(near)):
        if near[k] < 1e-3:
            continue
        for m in range(out.shape[0]):
            share = near[k] * weight[k, m]
            if share > 0:
                total[m] += share
                for channel in range(3):
                    out[m, channel] += share * colour[k, m, channel]
    for m in range(out.shape[0]):
        for channel in range(3):
            out[m, channel] /= total[m]
