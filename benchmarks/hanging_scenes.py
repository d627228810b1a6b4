"""Random scenes of bodies that hang on rods and swing, as people film them from the side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.clips.draw import in_view
from pipeline.errors import DynamicsError
from pipeline.physics.simulate import simulate
from pipeline.scene.rotation import quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import Camera, Joint, Scene, SceneObject
from pipeline.worlds.hanging import gyration

GRAVITY = 9.81
SHAPES = ("sphere", "cylinder", "box")
VISIBLE_PX = 150.0  # of a body in each frame, of a picture of 480x320
TRIES = 200


def draw_hanging_scene(rng: np.random.Generator, seconds: float) -> Scene:
    """A scene of one or two pendulums whose bodies stay in view.

    Args:
        rng: Random generator.
        seconds: Of the film.

    Raises:
        DynamicsError: None of the draws stays in view.
    """
    for _ in range(TRIES):
        scene = _drawn(rng)
        trace = simulate(scene, seconds)
        every = slice(None, None, trace.rate // 10)
        if in_view(scene, trace.position[every], trace.quaternion[every], VISIBLE_PX).all():
            return scene
    raise DynamicsError(f"none of {TRIES} draws of a pendulum stays in view")


def _drawn(rng: np.random.Generator) -> Scene:
    """Lengths are in units of the height that the camera sees; a point may be above the picture."""
    seen = float(np.exp(rng.uniform(*np.log([0.6, 2.5]))))  # m
    count = 1 if rng.random() < 0.7 else 2
    objects = []
    for k in range(count):
        arm = rng.uniform(0.35, 1.0) * seen
        lowest = rng.uniform(-0.35, -0.1) * seen
        across = (k - 0.5 * (count - 1)) * 0.75 * seen + rng.uniform(-0.1, 0.1) * seen
        angle = rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(10, 45)) * min(1.0, 0.4 * seen / (arm * count) + 0.3)
        objects.append(_hung(rng, seen, np.array([across, 0.0, lowest + arm]), arm, float(angle)))
    pitch = np.radians(90 + rng.uniform(-6, 2))
    fov = float(np.exp(rng.uniform(*np.log([15, 60]))))
    distance = seen / 2 / np.tan(np.radians(fov) / 2)
    turn = quaternion_from_rotation_vector(np.array([pitch, 0, 0]))
    roll = quaternion_from_rotation_vector(np.array([0, 0, np.radians(rng.uniform(-2, 2))]))
    back = distance * np.array([0, -np.sin(pitch), np.cos(pitch)])
    camera = Camera(tuple(back), fov, orientation=tuple(quaternion_multiply(turn, roll)))
    return Scene(tuple(objects), camera, ground=None)


def _hung(rng: np.random.Generator, seen: float, anchor: np.ndarray, arm: float, angle: float) -> SceneObject:
    shape = str(rng.choice(SHAPES))
    radius = rng.uniform(0.05, 0.1) * seen
    size = {"sphere": (radius,), "cylinder": (radius, 2 * radius), "box": tuple(rng.uniform(0.1, 0.18, 3) * seen)}[
        shape
    ]
    speed = rng.normal(0, 0.2) * np.sqrt(GRAVITY / arm)  # rad/s
    turn = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    body = SceneObject(
        shape,
        size,
        mass=float(np.exp(rng.uniform(*np.log([0.05, 2.0])))),
        position=tuple(anchor + arm * turn),
        velocity=tuple(arm * speed * np.array([-turn[2], 0.0, turn[0]])),
        angular_velocity=(0.0, -speed, 0.0),
        orientation=tuple(quaternion_from_rotation_vector(np.array([0.0, -angle, 0.0]))),
        joint=Joint("rod", tuple(anchor)),
    )
    assert body.joint is not None
    rate = np.exp(rng.uniform(*np.log([0.01, 0.3])))  # 1/s, of the amplitude's decay
    return replace(body, joint=replace(body.joint, damping=float(2 * rate * body.mass * arm * gyration(body))))
