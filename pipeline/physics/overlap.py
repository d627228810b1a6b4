"""Overlap of bodies by MuJoCo's distance function, and its removal."""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from pipeline.physics.batch import composition_model
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Scene, SceneObject, half_extents
from pipeline.scene.solid import geom_sizes, reach_below

TOLERANCE = 2e-4  # m of overlap that is not removed
ROUNDS = 30


@dataclass(frozen=True)
class Overlap:
    """Two objects that overlap.

    Attributes:
        first: Index of the first object.
        second: Index of the second object.
        depth: m.
        direction: (3,) unit vector in which the first object must move to leave the second.
    """

    first: int
    second: int
    depth: float
    direction: np.ndarray


def overlaps(scene: Scene) -> list[Overlap]:
    """All pairs of objects that overlap in the initial state."""
    if len(scene.objects) < 2:
        return []
    model, data = _scratch(scene.shapes)
    for i, obj in enumerate(scene.objects):
        model.geom_size[i] = geom_sizes(obj.shape, half_extents(obj)[None])[0]
        data.geom_xpos[i] = obj.position
        data.geom_xmat[i] = matrix_from_quaternion(np.array(obj.orientation)).ravel()
    points = np.zeros(6)
    found = []
    for i in range(len(scene.objects)):
        for j in range(i):
            if not _may_touch(scene.objects[i], scene.objects[j]):
                continue
            depth = -mujoco.mj_geomDistance(model, data, i, j, 1.0, points)
            if depth > 0:
                way = points[3:] - points[:3]  # from the surface of i to that of j, through both
                found.append(Overlap(i, j, depth, way / max(float(np.linalg.norm(way)), 1e-12)))
    return found


def ground_penetration(scene: Scene) -> np.ndarray:
    """Depth (N,) m by which each object penetrates the ground; negative above it."""
    ground = -np.inf if scene.ground is None else scene.ground
    return np.array([ground + reach_below(o) - o.position[2] for o in scene.objects])


def penetration(scene: Scene) -> float:
    """Largest overlap of two objects, or of an object and the ground, in the initial state, m; 0 without overlap."""
    return float(max([0.0, *(o.depth for o in overlaps(scene)), *ground_penetration(scene)]))


def separated(scene: Scene) -> Scene:
    """The scene with its objects moved apart, and out of the ground, until they overlap by at most `TOLERANCE`.

    It stops after `ROUNDS` rounds, when overlap may remain.
    """
    for _ in range(ROUNDS):
        shift = np.zeros((len(scene.objects), 3))
        depth = ground_penetration(scene)
        shift[:, 2] = np.where(depth > TOLERANCE, depth, 0)
        for o in overlaps(scene):
            if o.depth > TOLERANCE:
                shift[o.first] += 0.55 * o.depth * o.direction
                shift[o.second] -= 0.55 * o.depth * o.direction
        if not shift.any():
            break
        moved = (replace(o, position=tuple(np.add(o.position, s))) for o, s in zip(scene.objects, shift, strict=True))
        scene = replace(scene, objects=tuple(moved))
    return scene


@functools.lru_cache(maxsize=512)
def _scratch(shapes: tuple[str, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A copy of the model of a composition, and its data, to write sizes and poses into."""
    model = copy.copy(composition_model(shapes, False))
    return model, mujoco.MjData(model)


def _may_touch(a: SceneObject, b: SceneObject) -> bool:
    reach = np.linalg.norm(half_extents(a)) + np.linalg.norm(half_extents(b))
    return bool(np.linalg.norm(np.subtract(a.position, b.position)) < reach)
