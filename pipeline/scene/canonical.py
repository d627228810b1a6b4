"""The canonical description of an object: its symmetries resolved, its numbers rounded. So one motion has one text.

A sphere has no orientation. A cylinder or capsule looks the same when it is turned about its axis or end over end. A
box or ellipsoid looks the same under the 24 rotations of a cube if its sizes are permuted with it. Of all equivalent
descriptions the one with the smallest rotation is taken, so that an upright box has a yaw within 45 degrees.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion, quaternion_multiply
from pipeline.scene.scene import Scene, SceneObject

#: Decimals of each number of a scene: what the sampler rounds to and the model writes.
DECIMALS: dict[str, int] = {
    "camera.height": 2,
    "camera.pitch": 2,
    "camera.fov": 2,
    "gravity": 2,
    "size": 3,
    "mass": 2,
    "sliding_friction": 2,
    "rolling_friction": 3,
    "damping": 2,
    "position": 3,
    "velocity": 2,
    "angular_velocity": 2,
    "orientation": 3,
}


def _cube_rotations() -> tuple[np.ndarray, np.ndarray]:
    """The 24 rotations of the cube as quaternions (24, 4), identity first, and their axis permutations (24, 3)."""
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
    return quaternions, np.argmax(np.abs(matrices), axis=1)  # new axis j lies along old axis [j]


CUBE_ROTATIONS, CUBE_AXES = _cube_rotations()


def canonical_object(obj: SceneObject) -> SceneObject:
    """The same body with the canonical orientation, and for boxes and ellipsoids the sizes in its order."""
    if obj.shape == "sphere":
        return replace(obj, orientation=(1.0, 0.0, 0.0, 0.0))
    if obj.shape in ("cylinder", "capsule"):
        axis = matrix_from_quaternion(np.array(obj.orientation))[:, 2]
        return replace(obj, orientation=tuple(_rotation_of_z_to(_upward(axis))))
    if obj.shape in ("box", "ellipsoid"):
        turned = quaternion_multiply(np.array(obj.orientation), CUBE_ROTATIONS)
        best = int(np.argmax(np.round(np.abs(turned[:, 0]), 9)))
        size = np.array(obj.size)[CUBE_AXES[best]]
        return replace(obj, size=tuple(size), orientation=tuple(turned[best]))
    return obj


def _upward(axis: np.ndarray) -> np.ndarray:
    """`axis` or its opposite: whichever has z > 0, or y > 0 where z is 0, or x > 0 where both are 0."""
    rounded = np.round(axis, 6)
    leading = next((v for v in (rounded[2], rounded[1], rounded[0]) if v), 1.0)
    return axis if leading > 0 else -axis


def _rotation_of_z_to(axis: np.ndarray) -> np.ndarray:
    """The smallest rotation that takes z to the unit vector `axis` (with z >= 0)."""
    q = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return q / np.linalg.norm(q)


def rounded_object(obj: SceneObject) -> SceneObject:
    """The object with each number rounded to its `DECIMALS`."""
    values: dict[str, object] = {"size": tuple(round(v, DECIMALS["size"]) for v in obj.size)}
    for key in ("mass", "sliding_friction", "rolling_friction", "damping"):
        values[key] = round(getattr(obj, key), DECIMALS[key])
    for key in ("position", "velocity", "angular_velocity", "orientation"):
        values[key] = tuple(round(v, DECIMALS[key]) for v in getattr(obj, key))
    return replace(obj, **values)  # type: ignore[arg-type]


def rounded_scene(scene: Scene) -> Scene:
    """The scene with its objects, its gravity and a camera that has a pitch rounded to their `DECIMALS`."""
    camera = scene.camera
    if camera is not None and camera.pitch is not None:
        x, y, z = camera.position
        camera = replace(camera, position=(x, y, round(z, 2)), pitch=round(camera.pitch, 2), fov=round(camera.fov, 2))
    gravity = tuple(round(v, DECIMALS["gravity"]) for v in scene.gravity)
    return replace(scene, objects=tuple(map(rounded_object, scene.objects)), camera=camera, gravity=gravity)
