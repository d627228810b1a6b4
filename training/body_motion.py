"""The motion of rigid bodies between two frames of a camera at rest.

`sample_body_motion` draws bodies of every shape, seen from every side, so that the trained flow does not depend on how
the project draws its own scenes. Motions from those scenes are in `training/clip_motions.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.scene.rotation import integrate, quaternion_from_rotation_vector
from pipeline.scene.scene import SIZE_KEYS, Camera, SceneObject, half_extents
from pipeline.scene.solid import bounding_radii
from pipeline.vision.rendering.camera import Pinhole, pinhole

SECONDS = 1 / 30
SHAPES = ("sphere", "sphere", "cylinder", "cylinder", "box", "box", "capsule", "ellipsoid")
MOTIONS = ("slide", "roll", "roll", "fly", "fly", "spin", "rest")
MOVING = 2e-4  # m or half radians; a body whose pose changes by less is at rest
MAX_SPIN = 10.0  # rad/s
MAX_SPEED = 2.2  # m/s; half of the bodies are slower than a third of it


@dataclass(frozen=True)
class BodyMotion:
    """The poses of N bodies in two frames.

    Attributes:
        objects: The bodies.
        positions: (2, N, 3) m, world.
        quaternions: (2, N, 4) w, x, y, z.
        camera: The same for both frames.
    """

    objects: tuple[SceneObject, ...]
    positions: np.ndarray
    quaternions: np.ndarray
    camera: Pinhole

    @property
    def moves(self) -> np.ndarray:
        """(N,) bool: whether each body moves or turns visibly."""
        changes = np.abs(np.diff(np.concatenate([self.positions, self.quaternions], axis=-1), axis=0))
        return changes.max(axis=(0, 2)) > MOVING


def sample_camera(rng: np.random.Generator) -> Pinhole:
    """A camera at (0, -2, h), as in the paper, or, in three of ten cases, at any place above the scene."""
    fov = rng.uniform(28, 52)
    if rng.random() < 0.7:
        height = rng.uniform(0.4, 1.6)
        pitch = -math.degrees(math.atan2(height - 0.15, 2.0)) + rng.uniform(-7, 7)
        return pinhole(Camera(position=(0.0, -2.0, height), pitch=pitch, fov=fov))
    azimuth, elevation = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(5, 75))
    away = np.array([math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation)])
    back = np.array([*away, math.sin(elevation)])
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(back, right), back], axis=1)
    target = np.array([0.0, 0.0, rng.uniform(0.0, 0.3)])
    return Pinhole(target + back * rng.uniform(1.2, 4.0), rotation, fov)


def sample_object(rng: np.random.Generator) -> SceneObject:
    shape = SHAPES[rng.integers(len(SHAPES))]
    half = rng.uniform(0.05, 0.2, 3)
    if shape == "sphere":
        size: tuple[float, ...] = (half[0],)
    elif shape == "cylinder":
        size = (half[0], 2 * half[2])
    elif shape == "capsule":
        size = (half[0] * 0.7, 2 * half[0] * rng.uniform(0.9, 1.6))
    else:
        size = tuple(2 * half)
    assert len(size) == len(SIZE_KEYS[shape])
    return SceneObject(shape=shape, size=size, mass=1.0)


def sample_place(rng: np.random.Generator, camera: Pinhole, aspect: float) -> np.ndarray:
    """A point in view, m: on a ray through the middle nine tenths of the picture, at a depth of 1.2 to 3.6 m."""
    tangent = 0.9 * math.tan(math.radians(camera.fov_y_deg) / 2)
    ray = np.array([rng.uniform(-1, 1) * tangent * aspect, rng.uniform(-1, 1) * tangent, -1.0])
    return camera.position_world + camera.rotation_world @ ray * rng.uniform(1.2, 3.6)


def sample_body_motion(rng: np.random.Generator, aspect: float = 1.5) -> BodyMotion:
    """One to six bodies in view that do not overlap, each with a random motion over `SECONDS`."""
    camera = sample_camera(rng)
    objects: list[SceneObject] = []
    positions: list[np.ndarray] = []
    quaternions: list[np.ndarray] = []
    radii: list[float] = []
    for _ in range(rng.integers(1, 7)):
        obj = sample_object(rng)
        half = half_extents(obj)
        place = sample_place(rng, camera, aspect)
        if rng.random() < 0.5:  # upright, turned about the vertical
            turn = np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)])
            if obj.shape in ("cylinder", "capsule") and rng.random() < 0.5:  # lying
                turn = np.array([math.pi / 2, 0.0, 0.0])
        else:
            turn = rng.normal(size=3) * 1.5
        if rng.random() < 0.6 or place[2] < half[2]:
            place[2] = half[2] if obj.shape != "cylinder" or turn[0] == 0 else half[0]
        radius = float(bounding_radii(obj.shape, half[None])[0])
        if any(np.linalg.norm(place - p[0]) < radius + r for p, r in zip(positions, radii, strict=True)):
            continue
        velocity, spin = sample_velocity(rng, half)
        q = quaternion_from_rotation_vector(turn)
        objects.append(obj)
        radii.append(radius)
        positions.append(np.stack([place, place + velocity * SECONDS]))
        quaternions.append(np.stack([q, integrate(q, spin, SECONDS)]))
    return BodyMotion(tuple(objects), np.stack(positions, axis=1), np.stack(quaternions, axis=1), camera)


def sample_velocity(rng: np.random.Generator, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity, m/s, and angular velocity, rad/s, both (3,) in the world's frame."""
    kind = MOTIONS[rng.integers(len(MOTIONS))]
    heading, speed = rng.uniform(0, 2 * math.pi), MAX_SPEED * rng.random() ** 1.5
    level = speed * np.array([math.cos(heading), math.sin(heading), 0.0])
    if kind == "slide":
        return level, np.array([0.0, 0.0, rng.normal() * 3])
    if kind == "roll":
        return level, np.cross([0.0, 0.0, 1.0], level) / half[0] * rng.uniform(0.5, 1.1)
    if kind == "fly":
        direction = rng.normal(size=3)
        return speed * direction / np.linalg.norm(direction), random_spin(rng)
    if kind == "spin":
        return np.zeros(3), random_spin(rng)
    return np.zeros(3), np.zeros(3)


def random_spin(rng: np.random.Generator) -> np.ndarray:
    """(3,) rad/s, about a random axis, up to MAX_SPIN."""
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis) * rng.uniform(0, MAX_SPIN)
