"""Scenes of solid bodies for training masks: some rest, some are thrown at others, on level and tilted ground."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.errors import DynamicsError
from pipeline.physics.overlap import penetration
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.sample import Distribution, draw_scene
from pipeline.scene.scene import BASIC_SHAPES, Scene
from pipeline.scene.solid import reach_below
from pipeline.vision.rendering.camera import Pinhole, pinhole
from training.segmentation.backgrounds import log_uniform

#: Ranges that the project's own sampler has (params.yaml, sample.distribution), wider where reality is.
RANGES: dict[str, Any] = {
    "camera_height": (0.3, 1.6),
    "camera_distance": 2.0,
    "camera_target_height": (0.0, 0.25),
    "camera_fov": (28.0, 46.0),
    "gravity": (1.5, 12.0),
    "mass": (0.1, 4.0),
    "sliding_friction": (0.03, 1.0),
    "rolling_friction": (0.0, 0.01),
    "damping": (0.1, 1.0),
    "x": (-0.9, 0.9),
    "y": (-0.9, 1.1),
    "drop_height": (0.02, 0.8),
    "speed": (0.1, 2.2),
    "toward": 0.5,
    "rolling": 0.6,
    "spin": (0.5, 8.0),
    "lying": 0.4,
}
SIZES = {
    "sphere_radius": (0.07, 0.24),
    "cylinder_radius": (0.06, 0.2),
    "cylinder_height": (0.1, 0.4),
    "box_side": (0.12, 0.4),
}


def sample_distribution(rng: np.random.Generator) -> Distribution:
    """Ranges with one scale of bodies for the whole scene."""
    scale = log_uniform(rng, 0.4, 1.25)
    sizes: dict[str, Any] = {name: (max(0.03, scale * low), scale * high) for name, (low, high) in SIZES.items()}
    return Distribution(**RANGES, **sizes, airborne=float(rng.choice([0.05, 0.3, 0.6])))


def draw_moving_scene(rng: np.random.Generator, seconds: float) -> tuple[Scene, Trace, float] | None:
    """A scene of one to six bodies, its trace, and the tilt of the ground about the y axis, rad; None where the draw
    or the simulation fails. The ground is the plane z = 0 all the same: gravity is tilted against it."""
    count = int(rng.choice([1, 2, 3, 4, 5, 6], p=[0.12, 0.2, 0.24, 0.22, 0.14, 0.08]))
    shapes = [str(s) for s in rng.choice(BASIC_SHAPES, count)]
    for _ in range(200):
        scene = draw_scene(rng, shapes, sample_distribution(rng))
        if penetration(scene) <= 0:
            break
    else:
        return None
    objects = list(scene.objects)
    grounded = [o.position[2] < reach_below(o) + 0.01 for o in objects]
    share = float(rng.uniform(0.0, 0.75))
    rests = [bool(g and rng.random() < share) for g in grounded]
    if all(rests):
        rests[int(rng.integers(count))] = False
    for i, body in enumerate(objects):
        if rests[i]:
            objects[i] = replace(body, velocity=(0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 0.0))
        elif any(rests) and rng.random() < 0.5:  # at one that rests
            j = int(rng.choice(np.flatnonzero(rests)))
            way = np.array(objects[j].position[:2]) - np.array(body.position[:2])
            vx, vy = way / (np.linalg.norm(way) + 1e-6) * math.hypot(*body.velocity[:2])
            spin = body.angular_velocity
            if body.shape == "sphere" and grounded[i]:
                spin = tuple(np.cross([0, 0, 1.0], [vx, vy, 0]) / body.size[0])
            objects[i] = replace(body, velocity=(float(vx), float(vy), body.velocity[2]), angular_velocity=spin)
    tilt = math.radians(rng.uniform(3, 40)) * float(rng.choice([-1, 1])) if rng.random() < 0.15 else 0.0
    strength = -scene.gravity[2]
    gravity = (strength * math.sin(tilt), 0.0, -strength * math.cos(tilt))
    scene = replace(scene, objects=tuple(objects), gravity=gravity)
    try:
        return scene, simulate(scene, seconds), tilt
    except DynamicsError:
        return None


def sample_camera(rng: np.random.Generator, scene: Scene, position: np.ndarray, tilt: float) -> Pinhole:
    """The paper's camera in some clips, else one from anywhere; before tilted ground a level one from the side.

    position: (T, N, 3) m, of the bodies.
    """
    assert scene.camera is not None
    if tilt == 0 and rng.random() < 0.4:
        return pinhole(scene.camera)
    near = np.clip(position.reshape(-1, 3), -1.8, 1.8)
    target = np.median(near, axis=0) + rng.normal(0, 0.12, 3)
    target[2] = max(target[2], 0.02)
    reach = np.quantile(np.linalg.norm(near - target, axis=1), 0.85) + 0.15
    fov = rng.uniform(20, 58)
    distance = np.clip(reach / math.tan(math.radians(fov / 2)) * rng.uniform(0.6, 1.7), 0.8, 9)
    elevation = math.radians(
        float(rng.choice([rng.uniform(3, 55), rng.uniform(55, 89.5), rng.uniform(2, 12)], p=[0.7, 0.12, 0.18]))
    )
    azimuth = rng.uniform(-math.pi, math.pi)
    roll = math.radians(rng.normal(0, 2.0))
    if tilt:  # along y, so that what is level in the picture is level
        elevation, azimuth, roll = math.radians(rng.uniform(2, 20)), -math.pi / 2 + rng.normal(0, 0.1), roll - tilt
    back = np.array(
        [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
    )
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    right, up = math.cos(roll) * right + math.sin(roll) * up, -math.sin(roll) * right + math.cos(roll) * up
    return Pinhole(target + distance * back, np.stack([right, up, back], 1), fov)


def largest_turns(quaternion: np.ndarray) -> np.ndarray:
    """(N,) deg: the largest turn of each body from its first orientation. quaternion: (T, N, 4)."""
    out = np.zeros(quaternion.shape[1])
    for i in range(len(out)):
        turn = Rotation.from_quat(quaternion[:, i], scalar_first=True)
        out[i] = np.degrees((turn * turn[0].inv()).magnitude()).max()
    return out
