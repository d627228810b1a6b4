"""Overlap of bodies by MuJoCo's distance function, and its removal."""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from pipeline.physics.batch import FixedKind, composition_model
from pipeline.physics.trace import FIRST_FIXED
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import FixedBody, Scene, SceneObject, half_extents
from pipeline.scene.solid import geom_sizes, reach_below, support

TOLERANCE = 2e-4  # m of overlap that is not removed
ROUNDS = 60  # three crowded bodies can need more than 30


@dataclass(frozen=True)
class Overlap:
    """Two objects that overlap, or an object and a fixed body.

    Attributes:
        first: Index of the first object.
        second: Index of the second object; `FIRST_FIXED` - k for fixed body k, as in contacts.
        depth: m.
        direction: (3,) unit vector in which the first object must move to leave the second.
    """

    first: int
    second: int
    depth: float
    direction: np.ndarray


def overlaps(scene: Scene) -> list[Overlap]:
    """All pairs of objects, and of an object and a fixed body, that overlap in the initial state."""
    solids = [k for k, body in enumerate(scene.fixed) if body.shape != "plane"]
    found = []
    if len(scene.objects) + len(solids) > 1:
        model, data = _scratch(scene.shapes, tuple(scene.fixed[k].shape for k in solids))
        bodies: list[SceneObject | FixedBody] = [*(scene.fixed[k] for k in solids), *scene.objects]
        for geom, body in enumerate(bodies):
            model.geom_size[geom] = geom_sizes(body.shape, half_extents(body)[None])[0]
            data.geom_xpos[geom] = body.position
            data.geom_xmat[geom] = matrix_from_quaternion(np.array(body.orientation)).ravel()
        points = np.zeros(6)
        for i in range(len(solids), len(bodies)):
            for j in range(i):
                if not _may_touch(bodies[i], bodies[j]):
                    continue
                depth = -mujoco.mj_geomDistance(model, data, i, j, 1.0, points)
                if depth > 0:
                    way = points[3:] - points[:3]  # from the surface of i to that of j, through both
                    second = FIRST_FIXED - solids[j] if j < len(solids) else j - len(solids)
                    direction = way / max(float(np.linalg.norm(way)), 1e-12)
                    found.append(Overlap(i - len(solids), second, depth, direction))
    for k, body in enumerate(scene.fixed):
        if body.shape == "plane":
            found += _plane_overlaps(scene, body, FIRST_FIXED - k)
    return found


def _plane_overlaps(scene: Scene, plane: FixedBody, index: int) -> list[Overlap]:
    """The overlaps of the objects with a fixed plane; index: its index in contacts."""
    normal = matrix_from_quaternion(np.array(plane.orientation))[:, 2]
    found = []
    for i, obj in enumerate(scene.objects):
        down = matrix_from_quaternion(np.array(obj.orientation)).T @ -normal
        reach = support(obj.shape, half_extents(obj)[None], down[None])[0]
        depth = float(reach - normal @ np.subtract(obj.position, plane.position))
        if depth > 0:
            found.append(Overlap(i, index, depth, normal))
    return found


def ground_penetration(scene: Scene) -> np.ndarray:
    """Depth (N,) m by which each object penetrates the ground; negative above it."""
    ground = -np.inf if scene.ground is None else scene.ground
    return np.array([ground + reach_below(o) - o.position[2] for o in scene.objects])


def penetration(scene: Scene) -> float:
    """Largest overlap of two objects, or of an object and the ground or a fixed body, in the initial state, m.

    It is 0 without overlap.
    """
    return float(max([0.0, *(o.depth for o in overlaps(scene)), *ground_penetration(scene)]))


def separated(scene: Scene) -> Scene:
    """The scene with its objects moved apart, and out of ground and fixed bodies, until they overlap by `TOLERANCE`.

    It stops after `ROUNDS` rounds, when overlap may remain.
    """
    for _ in range(ROUNDS):
        shift = np.zeros((len(scene.objects), 3))
        depth = ground_penetration(scene)
        shift[:, 2] = np.where(depth > TOLERANCE, depth, 0)
        for o in overlaps(scene):
            if o.depth > TOLERANCE:
                both = o.second >= 0
                shift[o.first] += (0.55 if both else 1.0) * o.depth * o.direction
                if both:
                    shift[o.second] -= 0.55 * o.depth * o.direction
        if not shift.any():
            break
        moved = (replace(o, position=tuple(np.add(o.position, s))) for o, s in zip(scene.objects, shift, strict=True))
        scene = replace(scene, objects=tuple(moved))
    return scene


@functools.lru_cache(maxsize=512)
def _scratch(shapes: tuple[str, ...], fixed: tuple[str, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A copy of the model of a composition, and its data, to write sizes and poses into; fixed bodies come first."""
    model = copy.copy(composition_model(shapes, False, tuple(FixedKind(shape, False) for shape in fixed)))
    return model, mujoco.MjData(model)


def _may_touch(a: SceneObject | FixedBody, b: SceneObject | FixedBody) -> bool:
    reach = np.linalg.norm(half_extents(a)) + np.linalg.norm(half_extents(b))
    return bool(np.linalg.norm(np.subtract(a.position, b.position)) < reach)
