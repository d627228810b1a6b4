"""How far bodies overlap, by MuJoCo's own geometry."""

from __future__ import annotations

import copy
import functools

import mujoco
import numpy as np

from pipeline.physics.batch import composition_model
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Scene, SceneObject, half_extents
from pipeline.scene.solid import geom_sizes, reach_below


def penetration(scene: Scene) -> float:
    """Largest overlap between two objects or with the ground in the initial state, m; 0 where none touch."""
    worst = 0.0
    if scene.ground is not None:
        worst = max([scene.ground + reach_below(o) - o.position[2] for o in scene.objects], default=0.0)
    if len(scene.objects) > 1:
        model, data = _scratch(scene.shapes)
        for i, obj in enumerate(scene.objects):
            model.geom_size[i] = geom_sizes(obj.shape, half_extents(obj)[None])[0]
            data.geom_xpos[i] = obj.position
            data.geom_xmat[i] = matrix_from_quaternion(np.array(obj.orientation)).ravel()
        points = np.zeros(6)
        for i in range(len(scene.objects)):
            for j in range(i):
                if _may_touch(scene.objects[i], scene.objects[j]):
                    worst = max(worst, -mujoco.mj_geomDistance(model, data, i, j, 1.0, points))
    return max(worst, 0.0)


@functools.lru_cache(maxsize=64)
def _scratch(shapes: tuple[str, ...]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model and data of the composition, of our own, to write sizes and poses into."""
    model = copy.copy(composition_model(shapes, False))
    return model, mujoco.MjData(model)


def _may_touch(a: SceneObject, b: SceneObject) -> bool:
    reach = np.linalg.norm(half_extents(a)) + np.linalg.norm(half_extents(b))
    return bool(np.linalg.norm(np.subtract(a.position, b.position)) < reach)
