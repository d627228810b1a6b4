"""The scene of bodies that hang from points, from their swings in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.scene.scene import Joint, Scene, SceneObject
from pipeline.scene.solid import principal_moments
from pipeline.worlds.plane import Plane
from pipeline.worlds.swing import Swing


def hanging_scene(objects: Sequence[SceneObject], swings: Sequence[Swing], plane: Plane) -> Scene:
    """The scene in which each body hangs on a rod and swings as in the picture; its gravity is what the swings need.

    Args:
        objects: The bodies, of any place and motion.
        swings: Of each body.
        plane: In which they move.
    """
    hung = tuple(_hung(o, s, plane) for o, s in zip(objects, swings, strict=True))
    weights = [s.rate_error**-2 for s in swings]
    needed = [s.rate * gyration(o) for o, s in zip(hung, swings, strict=True)]
    return Scene(hung, plane.camera(), (0.0, 0.0, -float(np.average(needed, weights=weights))), ground=None)


def gyration(hung: SceneObject) -> float:
    """m, the length of the point pendulum that swings as a body on a rod does: inertia over mass and arm."""
    assert hung.joint is not None
    arm = float(np.linalg.norm(np.subtract(hung.position, hung.joint.anchor)))
    return arm + float(principal_moments(hung)[1]) / (hung.mass * arm)  # about y, normal to the plane


def _hung(body: SceneObject, swing: Swing, plane: Plane) -> SceneObject:
    """A body at its place and velocity of time 0, on a rod."""
    arm, turn = swing.length / plane.px_per_m, np.array([np.sin(swing.angle), -np.cos(swing.angle)])
    anchor = plane.to_world(swing.pivot)
    along = arm * swing.speed * np.array([-turn[1], turn[0]])
    hung = replace(
        body,
        position=tuple(plane.in_space(anchor + arm * turn)),
        velocity=tuple(plane.in_space(along)),
        angular_velocity=(0.0, -swing.speed, 0.0),
        joint=Joint("rod", tuple(plane.in_space(anchor))),
    )
    inertia = body.mass * arm * gyration(hung)
    joint = replace(hung.joint, damping=2 * swing.damping * inertia)  # type: ignore[type-var]
    return replace(hung, joint=joint)
