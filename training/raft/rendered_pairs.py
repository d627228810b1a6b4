"""Pairs of frames with exact flow, rendered by our ray caster or by MuJoCo."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.scene.scene import Camera, Scene
from pipeline.vision.rendering.appearance import (
    Appearance,
    apply_sensor,
    plain_appearance,
    sample_appearance,
    sample_sensor,
)
from pipeline.vision.rendering.camera import Pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.shade import shade
from training.body_motion import BodyMotion
from training.frame_pair import FramePair

ZOOM = (-0.15, 0.25)  # range of the logarithm of a window's magnification


def sample_pair_appearance(rng: np.random.Generator, n_objects: int) -> Appearance:
    """A random appearance.

    One in ten is the plain appearance; one in ten has bodies of one colour each on a floor of one colour, where only
    the outlines show the motion.
    """
    kind = rng.random()
    if kind < 0.1:
        return plain_appearance(n_objects)
    if kind < 0.2:
        return sample_appearance(rng, n_objects, textures={"plain": 1.0}, floor_textures={"plain": 1.0})
    textures = {"plain": 1.0, "stripes": 1.0, "checker": 1.0, "noise": 1.0, "spots": 1.0}
    return sample_appearance(rng, n_objects, textures=textures, texture_scale=(0.03, 0.2), floor_scale=(0.04, 0.8))


def render_pair(
    rng: np.random.Generator, motion: BodyMotion, appearance: Appearance, width: int, height: int, mujoco: bool = False
) -> FramePair:
    """The two frames of a motion and their exact flow.

    Args:
        rng: Draws shadows and antialiasing.
        motion: Of the bodies.
        appearance: Of bodies, floor and lights.
        width: px.
        height: px.
        mujoco: Whether MuJoCo renders, not our ray caster.
    """
    poses = (motion.objects, motion.positions, motion.quaternions, motion.camera)
    rendering = rasterise(*poses, width, height)
    flow = exact_flow(*poses, width, height, rendering=rendering)[0]
    foreground = np.concatenate([[False], motion.moves])[rendering.mask[0]]
    shadows = bool(rng.random() < 0.8)
    if mujoco:
        from pipeline.vision.rendering.mujoco_render import (
            render_mujoco,  # MuJoCo looks for a display where it is imported
        )

        frames = render_mujoco(as_scene(motion), *poses[1:3], appearance, width, height, shadows)
    else:
        antialias = bool(rng.random() < 0.8)
        frames = shade(*poses, appearance, width, height, shadows=shadows, antialias=antialias)
    return FramePair(frames[0], frames[1], flow, foreground)


def project_pair(rng: np.random.Generator, motion: BodyMotion, width: int, height: int, mujoco: bool) -> FramePair:
    """A pair of whole pictures with an appearance and a sensor as the project's clips have them."""
    pair = render_pair(rng, motion, sample_appearance(rng, len(motion.objects)), width, height, mujoco)
    frames = apply_sensor(np.stack([pair.frame_a, pair.frame_b]), sample_sensor(rng), rng)
    return replace(pair, frame_a=frames[0], frame_b=frames[1])


def window_pair(
    rng: np.random.Generator, motion: BodyMotion, width: int, height: int, full_height: int, mujoco: bool
) -> FramePair:
    """A pair of windows, near a moving body, of a picture with a random appearance.

    Args:
        rng: Draws the window, its magnification and the appearance.
        motion: Of the bodies.
        width: Of the window, px.
        height: Of the window, px.
        full_height: Of the picture, px, before the magnification.
        mujoco: Whether MuJoCo renders, not our ray caster.
    """
    zoom = math.exp(rng.uniform(*ZOOM))
    motion = aimed(rng, motion, height / full_height / zoom)
    return render_pair(rng, motion, sample_pair_appearance(rng, len(motion.objects)), width, height, mujoco)


def as_scene(motion: BodyMotion) -> Scene:
    """The bodies and the camera as a scene, for MuJoCo's renderer."""
    camera = motion.camera
    w, x, y, z = Rotation.from_matrix(camera.rotation_world).as_quat(scalar_first=True)
    place = tuple(camera.position_world)
    return Scene(motion.objects, Camera(place, camera.fov_y_deg, orientation=(w, x, y, z)))


def aimed(rng: np.random.Generator, motion: BodyMotion, share: float) -> BodyMotion:
    """The motion, seen through a window near a random moving body; the window's height is `share` of the picture's.

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
