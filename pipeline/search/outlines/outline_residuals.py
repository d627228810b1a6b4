"""Distances of a clip's outlines, at the clip's resolution, to the silhouettes of simulated candidates.

They are linear in small changes of place and size, where pooled masks of 120x80 no longer tell a difference. A distance
is in units of the instance's radius and saturates, so that a body far off does not outweigh all others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import prange

from pipeline.compiled import parallel_kernel
from pipeline.physics.batch import SceneBatch
from pipeline.scene.rotation import fill_matrix
from pipeline.search.outlines.contour import Contour
from pipeline.search.outlines.silhouette import DIRECTIONS, fill_distances, fill_support
from pipeline.vision.rendering.surface import KINDS

POINTS = 32  # of the outline of an instance in a frame
WEIGHT = 4.5  # of the root mean square of the distances: so a tenth of the radius costs as much as an IoU of 0.8
MOST = 0.3  # radii, the limit of a distance


@parallel_kernel
def _fill(
    kinds: np.ndarray,
    instances: np.ndarray,
    half: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera_position: np.ndarray,
    camera_rotation: np.ndarray,
    fov: np.ndarray,
    height: int,
    points: np.ndarray,
    free: np.ndarray,
    count: np.ndarray,
    radius: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out (B, F, N, P); see `OutlineTarget.residuals`. instances: (N,), -1 for none."""
    for b in prange(position.shape[0]):
        focal = height / (2.0 * np.tan(np.radians(fov[b]) * 0.5))
        support, distance = np.empty(DIRECTIONS), np.empty(points.shape[2])
        nearest = np.empty(points.shape[2], np.int64)
        body, local, centre = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        for k in range(position.shape[1]):
            for i in range(len(kinds)):
                j = instances[i]
                if j < 0 or count[k, j] == 0:
                    continue
                fill_matrix(quaternion[b, k, i], body)
                for r in range(3):
                    centre[r] = 0.0
                    for c in range(3):
                        centre[r] += camera_rotation[b, c, r] * (position[b, k, i, c] - camera_position[b, c])
                        local[r, c] = (
                            camera_rotation[b, 0, r] * body[0, c]
                            + camera_rotation[b, 1, r] * body[1, c]
                            + camera_rotation[b, 2, r] * body[2, c]
                        )
                seen = fill_support(kinds[i], half[b, i], local, centre, support)
                scale = np.sqrt(1.0 / count[k, j])
                if not seen:
                    for p in range(count[k, j]):
                        out[b, k, i, p] = MOST * scale
                    continue
                fill_distances(points[k, j], count[k, j], focal, support, distance, nearest)
                for p in range(count[k, j]):
                    if free[k, j, p] or distance[p] > 0:
                        d = distance[p] / radius[j]
                        out[b, k, i, p] = scale * d / np.sqrt(1.0 + (d / MOST) ** 2)


class OutlineTarget:
    """The outlines of the target's frames, and the residuals of candidates against them.

    Args:
        contours: Of each instance, in frames of the clip.
        frames: (F,) the clip's frames that the target shows, as positions among those of the contours.
        height: Of the clip's masks, px.
    """

    def __init__(self, contours: Sequence[Contour], frames: np.ndarray, height: int) -> None:
        shape = (len(frames), len(contours), POINTS)
        self._points, self._free = np.zeros((*shape, 2)), np.zeros(shape, bool)
        self._count, self._radius = np.zeros(shape[:2], np.int64), np.ones(len(contours))
        self._height = height
        for j, contour in enumerate(contours):
            place = {int(frame): k for k, frame in enumerate(contour.frames)}
            if len(contour.area):
                self._radius[j] = np.sqrt(contour.area.mean() / np.pi)
            for k, frame in enumerate(frames):
                at = place.get(int(frame))
                if at is None:
                    continue
                n = int(contour.count[at])
                take = np.unique(np.linspace(0, n - 1, min(n, POINTS)).round().astype(int))
                self._count[k, j] = len(take)
                self._points[k, j, : len(take)] = contour.points[at, take]
                self._free[k, j, : len(take)] = contour.free[at, take]

    def residuals(
        self, scenes: SceneBatch, position: np.ndarray, quaternion: np.ndarray, pairs: np.ndarray
    ) -> np.ndarray:
        """Residuals (B, N, F POINTS) float32 with equal weights for all frames, 0 for objects without an instance.

        Args:
            scenes: B candidates of one composition.
            position: (B, F, N, 3) m, of the objects in the target's first F frames.
            quaternion: (B, F, N, 4).
            pairs: (P, 2) objects and instances.
        """
        count, frames, objects = position.shape[:3]
        instances = np.full(objects, -1)
        instances[pairs[:, 0]] = pairs[:, 1]
        known = [i for i, shape in enumerate(scenes.shapes) if shape not in ("sphere", "cylinder", "box")]
        instances[known] = -1  # other shapes have no silhouette in closed form
        out = np.zeros((count, frames, objects, POINTS))
        kinds = np.array([KINDS[s] for s in scenes.shapes])
        _fill(
            kinds,
            instances,
            scenes.half_size,
            np.ascontiguousarray(position),
            np.ascontiguousarray(quaternion),
            scenes.camera_position,
            np.ascontiguousarray(scenes.camera_rotation),
            scenes.fov,
            self._height,
            self._points,
            self._free,
            self._count,
            self._radius,
            out,
        )
        out *= WEIGHT / np.sqrt(frames)
        return out.transpose(0, 2, 1, 3).reshape(count, objects, -1).astype(np.float32)
