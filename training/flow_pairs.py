"""Pairs of frames with exact flow, made on the fly: random bodies that move a little before a resting camera.

The distribution covers clips at 240x160 and 1/30 s: 1 to 6 bodies of 0.05 to 0.2 m that slide, roll, fly, spin or
rest, seen by the paper's camera or by any other. What they look like is drawn by `pipeline.vision.appearance`;
the picture is our ray caster's or MuJoCo's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.scene.rotation import integrate, quaternion_from_rotation_vector
from pipeline.scene.scene import SIZE_KEYS, Camera, Scene, SceneObject, half_extents
from pipeline.scene.solid import bounding_radii
from pipeline.vision.appearance import Appearance, plain_appearance, sample_appearance
from pipeline.vision.camera import Pinhole, pinhole
from pipeline.vision.exact_flow import exact_flow
from pipeline.vision.rasteriser import rasterise
from pipeline.vision.shade import shade

SECONDS = 1 / 30
SHAPES = ("sphere", "sphere", "cylinder", "cylinder", "box", "box", "capsule", "ellipsoid")
MOTIONS = ("slide", "roll", "roll", "fly", "fly", "spin", "rest")
ZOOM = 1.4
FASTEST = 2.2  # m/s; half of the bodies are slower than a third of it


@dataclass(frozen=True)
class Pair:
    """frame_a, frame_b: (H, W, 3) uint8. flow_px: (H, W, 2) float32. foreground: (H, W) bool, the first frame's pixels
    of bodies that move or turn."""

    frame_a: np.ndarray
    frame_b: np.ndarray
    flow_px: np.ndarray
    foreground: np.ndarray

    def mirrored(self) -> Pair:
        """Left and right exchanged."""
        flow = self.flow_px[:, ::-1] * np.array([-1, 1], np.float32)
        return Pair(self.frame_a[:, ::-1], self.frame_b[:, ::-1], flow, self.foreground[:, ::-1])


@dataclass(frozen=True)
class Motion:
    """Bodies before and after: positions (2, N, 3) m, quaternions (2, N, 4); the camera rests."""

    objects: tuple[SceneObject, ...]
    positions: np.ndarray
    quaternions: np.ndarray
    camera: Pinhole

    @property
    def moves(self) -> np.ndarray:
        """(N,) bool: whether each body moves or turns."""
        changes = np.abs(np.diff(np.concatenate([self.positions, self.quaternions], axis=-1), axis=0))
        return changes.max(axis=(0, 2)) > 1e-9


def sample_camera(rng: np.random.Generator) -> Pinhole:
    """The paper's camera at (0, -2, h), or (three in ten) one that looks at the scene from anywhere above."""
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


def sample_motion(rng: np.random.Generator, seconds: float = SECONDS, aspect: float = 1.5) -> Motion:
    """One to six bodies in view that do not overlap, each with a random motion over `seconds`."""
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
        positions.append(np.stack([place, place + velocity * seconds]))
        quaternions.append(np.stack([q, integrate(q, spin, seconds)]))
    return Motion(tuple(objects), np.stack(positions, axis=1), np.stack(quaternions, axis=1), camera)


def sample_velocity(rng: np.random.Generator, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity, m/s, and angular velocity, rad/s, both (3,) in the world's frame."""
    kind = MOTIONS[rng.integers(len(MOTIONS))]
    heading, speed = rng.uniform(0, 2 * math.pi), FASTEST * rng.random() ** 1.5
    level = speed * np.array([math.cos(heading), math.sin(heading), 0.0])
    if kind == "slide":
        return level, np.array([0.0, 0.0, rng.normal() * 3])
    if kind == "roll":
        return level, np.cross([0.0, 0.0, 1.0], level) / half[0] * rng.uniform(0.5, 1.1)
    if kind == "fly":
        direction = rng.normal(size=3)
        return speed * direction / np.linalg.norm(direction), rng.normal(size=3) * 6
    if kind == "spin":
        return np.zeros(3), rng.normal(size=3) * 8
    return np.zeros(3), np.zeros(3)


def sample_looks(rng: np.random.Generator, n_objects: int) -> Appearance:
    """A random appearance; one in eight is the plain one of every undecorated scene, one in eight has bodies of one
    colour each on a floor of one colour, where the outline alone tells the motion."""
    kind = rng.random()
    if kind < 0.125:
        return plain_appearance(n_objects)
    if kind < 0.25:
        return sample_appearance(rng, n_objects, textures={"plain": 1.0}, floor_textures={"plain": 1.0})
    textures = {"plain": 1.5, "stripes": 1.0, "checker": 1.0, "noise": 1.0, "spots": 1.0}
    return sample_appearance(rng, n_objects, textures=textures, texture_scale=(0.03, 0.2), floor_scale=(0.04, 0.8))


def render_pair(rng: np.random.Generator, motion: Motion, width: int, height: int, mujoco_share: float) -> Pair:
    """The motion's two frames, by MuJoCo or our ray caster, with a random appearance, and its exact flow."""
    poses = (motion.objects, motion.positions, motion.quaternions, motion.camera)
    rendering = rasterise(*poses, width, height)
    flow = exact_flow(*poses, width, height, rendering=rendering, with_hidden=False).flow_px[0]
    foreground = np.concatenate([[False], motion.moves])[rendering.mask[0]]
    appearance = sample_looks(rng, len(motion.objects))
    shadows = bool(rng.random() < 0.8)
    if rng.random() < mujoco_share:
        from pipeline.vision.mujoco_render import render_mujoco  # MuJoCo looks for a display where it is imported

        frames = render_mujoco(as_scene(motion), *poses[1:3], appearance, width, height, shadows)
    else:
        antialias = bool(rng.random() < 0.8)
        frames = shade(*poses, appearance, width, height, shadows=shadows, antialias=antialias)
    return Pair(frames[0], frames[1], flow, foreground)


def as_scene(motion: Motion) -> Scene:
    camera = motion.camera
    w, x, y, z = Rotation.from_matrix(camera.rotation_world).as_quat(scalar_first=True)
    place = tuple(camera.position_world)
    return Scene(motion.objects, Camera(place, camera.fov_y_deg, orientation=(w, x, y, z)))


def aimed(rng: np.random.Generator, motion: Motion, share: float) -> Motion:
    """The motion through a window `share` as high as the picture, somewhere about a random moving body.

    The camera is turned towards the window and its field of view narrowed, so that a pixel spans the same angle.
    """
    camera = motion.camera
    bodies = np.flatnonzero(motion.moves) if motion.moves.any() else np.arange(len(motion.objects))
    body = motion.positions[0, rng.choice(bodies)]
    tangent = share * math.tan(math.radians(camera.fov_y_deg) / 2)
    depth = float((camera.position_world - body) @ camera.rotation_world[:, 2])
    across = camera.rotation_world[:, :2] @ rng.uniform(-0.8, 0.8, 2)
    back = camera.position_world - (body + across * depth * tangent)
    back /= np.linalg.norm(back)
    right = np.cross(camera.rotation_world[:, 1], back)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(back, right), back], axis=1)
    return replace(motion, camera=Pinhole(camera.position_world, rotation, 2 * math.degrees(math.atan(tangent))))


def sample_pair(rng: np.random.Generator, width: int, height: int, mujoco_share: float = 0.0) -> Pair:
    """A random pair of whole pictures, 1/30 s apart. MuJoCo renders `mujoco_share` of the pairs."""
    return render_pair(rng, sample_motion(rng), width, height, mujoco_share)


def sample_window(
    rng: np.random.Generator, width: int, height: int, full_height: int, mujoco_share: float = 0.0
) -> Pair:
    """A random pair seen through a window, about a moving body, into a picture `full_height` px high, which is
    enlarged by up to ZOOM; the time between the frames is then as much shorter."""
    zoom = math.exp(rng.uniform(-0.15, math.log(ZOOM)))
    motion = aimed(rng, sample_motion(rng, SECONDS / zoom), height / full_height / zoom)
    return render_pair(rng, motion, width, height, mujoco_share)
