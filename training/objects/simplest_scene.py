"""The simplest scene that explains a clip as well as a searched one: bodies upright, on the ground, without spin.

A search leaves small tilts, gaps above the ground, vertical velocities and spins where the clip does not determine
them. In most scenes these numbers are exactly 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.scene.canonical import canonical_object
from pipeline.scene.scene import Scene, SceneObject
from pipeline.scene.solid import reach_below
from pipeline.search.best_of_k import rank
from pipeline.search.evaluator import Evaluator

MOST_LOSS = 0.01  # of the reward, that one simplification may cost
LEAST_REAL = 0.5  # of an orientation's yaw; a body that is tilted further is not set upright
GAP = 0.0005  # m, of a body on the ground


def upright(body: SceneObject) -> SceneObject:
    """The body with its yaw alone."""
    w, _, _, z = body.orientation
    length = float(np.hypot(w, z))
    return body if length < LEAST_REAL else replace(body, orientation=(w / length, 0.0, 0.0, z / length))


def grounded(body: SceneObject) -> SceneObject:
    """The body on the ground, without a vertical velocity."""
    position = (*body.position[:2], reach_below(body) + GAP)
    return replace(body, position=position, velocity=(*body.velocity[:2], 0.0))


def spinning(body: SceneObject, horizontal: float, vertical: float) -> SceneObject:
    """The body with these shares of its spin about the horizontal axes and the vertical one."""
    x, y, z = body.angular_velocity
    return replace(body, angular_velocity=(horizontal * x, horizontal * y, vertical * z))


SIMPLER = (
    lambda body: grounded(upright(body)),
    upright,
    grounded,
    lambda body: replace(body, velocity=(*body.velocity[:2], 0.0)),
    lambda body: spinning(body, 0.0, 0.0),
    lambda body: spinning(body, 0.0, 1.0),
    lambda body: spinning(body, 1.0, 0.0),
)


def simplest_scene(evaluator: Evaluator, scene: Scene) -> Scene:
    """The scene in canonical form, with each simplification of a body that costs at most MOST_LOSS of the reward.

    Args:
        evaluator: Of the clip.
        scene: What a search found.
    """
    scene = replace(scene, objects=tuple(canonical_object(body) for body in scene.objects))
    reward = float(rank(evaluator, [scene]).rewards.reward[0])
    for i in range(len(scene.objects)):
        for simpler in SIMPLER:
            body = simpler(scene.objects[i])
            if body == scene.objects[i]:
                continue
            tried = replace(scene, objects=(*scene.objects[:i], body, *scene.objects[i + 1 :]))
            found = float(rank(evaluator, [tried]).rewards.reward[0])
            if found >= reward - MOST_LOSS:
                scene, reward = tried, found
    return scene
