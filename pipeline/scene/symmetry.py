"""One text per motion: the symmetries of each shape resolved one way.

A sphere has no orientation, a cylinder or capsule none about its axis nor end over end, a box or ellipsoid is
the same under the 24 rotations of a cube if its sizes are permuted along. Of all equal descriptions the one
with the smallest turn is taken, so that a standing box has a yaw within 45 degrees.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion, quaternion_multiply
from pipeline.scene.scene import SceneObject


def _cube_rotations() -> tuple[np.ndarray, np.ndarray]:
    """The 24 rotations of the cube as quaternions (24, 4), identity first, and the axes they permute (24, 3)."""
    candidates = []
    for parts in itertools.product((-1.0, 0.0, 1.0), repeat=4):
        q = np.array(parts)
        if np.count_nonzero(q) in (1, 2, 4):
            q /= np.linalg.norm(q)
            if next(v for v in q if v) > 0:
                candidates.append(q)
    quaternions = np.array(sorted(candidates, key=lambda q: tuple(-q)))
    assert len(quaternions) == 24
    matrices = matrix_from_quaternion(quaternions)
    return quaternions, np.argmax(np.abs(matrices), axis=1)  # column j of the turned frame lies along old axis [j]


CUBE_ROTATIONS, CUBE_AXES = _cube_rotations()


def canonical_object(obj: SceneObject) -> SceneObject:
    """The same body, described in the one agreed way."""
    if obj.shape == "sphere":
        return replace(obj, orientation=(1.0, 0.0, 0.0, 0.0))
    if obj.shape in ("cylinder", "capsule"):
        axis = matrix_from_quaternion(np.array(obj.orientation))[:, 2]
        return replace(obj, orientation=tuple(_turn_of_z_to(_upward(axis))))
    if obj.shape in ("box", "ellipsoid"):
        turned = quaternion_multiply(np.array(obj.orientation), CUBE_ROTATIONS)
        best = int(np.argmax(np.round(np.abs(turned[:, 0]), 9)))
        size = np.array(obj.size)[CUBE_AXES[best]]
        return replace(obj, size=tuple(size), orientation=tuple(turned[best]))
    return obj


def _upward(axis: np.ndarray) -> np.ndarray:
    """`axis` or its opposite: z up, or for a lying axis y away from the camera, or x to the right."""
    rounded = np.round(axis, 6)
    leading = next((v for v in (rounded[2], rounded[1], rounded[0]) if v), 1.0)
    return axis if leading > 0 else -axis


def _turn_of_z_to(axis: np.ndarray) -> np.ndarray:
    """The smallest rotation that takes z to the unit vector `axis` (with z >= 0)."""
    q = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return q / np.linalg.norm(q)
