"""How far bodies overlap, by MuJoCo's own geometry, and how to part them."""

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

APART = 2e-4  # m of overlap that is left
ROUNDS = 30


@dataclass(frozen=True)
class Overlap:
    """Two objects that overlap by `depth`, m; direction (3,): the way in which the first leaves the second."""

    first: int
    second: int
    depth: float
    direction: np.ndarray


def overlaps(scene: Scene) -> list[Overlap]:
    """Every pair of objects that overlap in the initial state."""
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


def sunk(scene: Scene) -> np.ndarray:
    """(N,) how far each object reaches into the ground, m; negative above it."""
    ground = -np.inf if scene.ground is None else scene.ground
    return np.array([ground + reach_below(o) - o.position[2] for o in scene.objects])


def penetration(scene: Scene) -> float:
    """Largest overlap between two objects or with the ground in the initial state, m; 0 where none touch."""
    return float(max([0.0, *(o.depth for o in overlaps(scene)), *sunk(scene)]))


def separated(scene: Scene) -> Scene:
    """The scene with its objects pushed apart, and out of the ground, until they overlap by APART at most; where that
    does not come about in ROUNDS rounds, as far as it got."""
    for _ in range(ROUNDS):
        shift = np.zeros((len(scene.objects), 3))
        depth = sunk(scene)
        shift[:, 2] = np.where(depth > APART, depth, 0)
        for o in overlaps(scene):
            if o.depth > APART:
                shift[o.first] += 0.55 * o.depth * o.direction
                shift[o.second] -= 0.55 * o.depth * o.direction
        if not shift.any():
            break
        moved = (replace(o, position=tuple(np.add(o.position, s))) for o, s in zip(scene.objects, shift, strict=True))
        scene = replace(scene, objects=tuple(moved))
    return scene


@functools.lru_cache(maxsize=512)
def _scratch(shapes: tuple[str, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model and data of the composition, of our own, to write sizes and poses into."""
    model = copy.copy(composition_model(shapes, False))
    return model, mujoco.MjData(model)


def _may_touch(a: SceneObject, b: SceneObject) -> bool:
    reach = np.linalg.norm(half_extents(a)) + np.linalg.norm(half_extents(b))
    return bool(np.linalg.norm(np.subtract(a.position, b.position)) < reach)
