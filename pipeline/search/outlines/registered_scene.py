"""A scene from solids that were registered to each instance's outlines: camera, ground, sizes and first motion.

Registrations are in the camera frame and each has a scale of its own. The ground gives them a common one: each body
touches it at some time. Its slope in the picture follows from bodies that stand on a face and from bodies whose lowest
point keeps its height above the same plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.scene.scene import Scene, SceneObject, size_from_half
from pipeline.scene.solid import reach_below, support
from pipeline.search.guess import CAMERA, GRAVITY, PITCH_SPREAD, USUAL_PITCH, usual_object
from pipeline.search.outlines.registration import Registration
from pipeline.vision.rendering.camera import Pinhole, pinhole

PITCHES = np.arange(-60.0, 0.1, 0.5)  # deg, that are tried
STANDING = np.radians(1.5)  # rad, spread of the axis of a standing body about the vertical
LEVEL = 0.01  # spread of the height of the lowest point of a body on the ground, share of the camera's height
USUAL_HALF = 0.13  # m, mean of half extents, which fixes the scale
HEIGHTS = (0.35, 1.8)  # m, range of the camera's height
UPRIGHT = np.radians(8.0)  # rad: a body on the ground that leans by less stands on a face
GROUNDED = 0.12  # gap to the ground, in mean half extents, up to which a body stands on it
MOTION_SECONDS = 0.24  # part of the track that gives the first velocities
TURN_SECONDS = 0.15
GRAVITIES = (GRAVITY, 0.5 * GRAVITY, 1.5 * GRAVITY)  # that are tried
FASTEST, FASTEST_SPIN = 4.0, 20.0  # m/s, rad/s


class Support(Enum):
    """Where a body is at first: where its track says, on the ground, or in the air."""

    SEEN = "seen"
    GROUND = "ground"
    AIR = "air"


def up_direction(pitch: float) -> np.ndarray:
    """(3,) the vertical in the frame of a camera with this pitch, deg."""
    return np.array([0.0, np.cos(np.radians(pitch)), -np.sin(np.radians(pitch))])


def lowest_points(track: Registration, up: np.ndarray) -> np.ndarray:
    """(K,) m, height of a body's lowest point above the camera; up (3,) in the camera frame."""
    down = track.rotations.transpose(0, 2, 1) @ up
    return track.centres @ up - support(track.shape, np.repeat(track.half[None], len(down), 0), down)


def likely_pitch(tracks: Sequence[Registration]) -> float:
    """The pitch, deg, at which most bodies stand upright or keep the height of their lowest point."""
    scores = []
    for pitch in PITCHES:
        up = up_direction(pitch)
        score = ((pitch - USUAL_PITCH) / PITCH_SPREAD) ** 2
        for track in tracks:
            lowest = lowest_points(track, up)
            if np.median(lowest) >= 0:
                score += 4.0 * len(lowest)
                continue
            errors = [(lowest / np.quantile(lowest, 0.2) - 1) / LEVEL]
            if track.shape != "sphere":
                errors.append(_lean(track, up) / STANDING)
            score += sum(float(np.log1p(e**2).mean()) for e in errors) * min(len(lowest), 10)
        scores.append(score)
    return float(PITCHES[int(np.argmin(scores))])


def _lean(track: Registration, up: np.ndarray) -> np.ndarray:
    """(K,) rad, by how much the body must be turned to stand on a face or, if a cylinder, also to lie on its side."""
    along = np.abs(track.rotations.transpose(0, 2, 1) @ up)
    if track.shape == "cylinder":
        axis = along[:, 2]
        return np.minimum(np.arccos(np.clip(axis, 0, 1)), np.arcsin(np.clip(axis, 0, 1)))
    return np.arccos(np.clip(along.max(1), 0, 1))


def registered_scenes(registrations: Sequence[Registration], height_px: int) -> list[Scene]:
    """Scenes in which object i is registration i: for each gravity of `GRAVITIES` one for each kind of `Support`.

    Args:
        registrations: One of each instance.
        height_px: Height of the picture.
    """
    weights = np.array([r.points * np.sqrt(np.exp(2 * np.log(r.extents).mean())) for r in registrations])
    focal = float(np.exp(np.average(np.log([r.focal for r in registrations]), weights=weights)))
    pitch = likely_pitch(registrations)
    up = up_direction(pitch)
    scales = np.array([-1 / min(float(np.quantile(lowest_points(r, up), 0.1)), -0.1) for r in registrations])
    mean_half = np.array([np.exp(np.log(r.half).mean()) for r in registrations])
    height = float(np.clip(USUAL_HALF / np.exp(np.log(scales * mean_half).mean()), *HEIGHTS))
    fov = float(np.degrees(2 * np.arctan(0.5 * height_px / focal)))
    camera = replace(CAMERA, position=(*CAMERA.position[:2], height), fov=fov, pitch=pitch)
    view = pinhole(camera)
    scenes = []
    for gravity in GRAVITIES:
        for first in Support:
            objects = []
            for track, scale in zip(registrations, scales, strict=True):
                if first is Support.GROUND:  # it is as far away as the ground at its lowest point
                    early = track.times <= track.times[0] + MOTION_SECONDS
                    scale = -1 / min(float(np.median(lowest_points(track, up)[early])), -0.1)
                objects.append(_object(track, scale * height, view, gravity, first))
            scenes.append(Scene(tuple(objects), camera, (0.0, 0.0, -gravity)))
    return scenes


def _object(track: Registration, scale: float, view: Pinhole, gravity: float, first_support: Support) -> SceneObject:
    """The object of a track whose lengths are multiplied by `scale`."""
    half = scale * track.half
    position = scale * track.centres @ view.rotation_world.T + view.position_world
    rotation = view.rotation_world @ track.rotations
    lowest = position[:, 2] - support(
        track.shape, np.repeat(half[None], len(rotation), 0), rotation.transpose(0, 2, 1)[:, :, 2]
    )
    first = track.times[0]
    early = track.times <= first + MOTION_SECONDS
    since = track.times[early] - first
    gap = GROUNDED * np.exp(np.log(half).mean())
    grounded = bool(np.median(lowest[early]) < gap and lowest[0] < 2 * gap)
    if first_support is not Support.SEEN:
        grounded = first_support is Support.GROUND
    velocity, start = np.zeros(3), position[0].copy()
    if len(since) > 1:
        line = np.stack([np.ones(len(since)), since], 1)
        moved = position[early] + 0.5 * gravity * since[:, None] ** 2 * np.array([0.0, 0.0, 0.0 if grounded else 1.0])
        start, velocity = np.linalg.lstsq(line, moved, rcond=None)[0]
    speed = float(np.linalg.norm(velocity))
    velocity *= min(1.0, FASTEST / max(speed, 1e-9))
    turn = rotation[0]
    spin = _first_spin(track, view)
    if grounded:
        velocity[2] = 0.0
        turn = _stood(track.shape, turn)
        if not _spin_seen(track):
            spin = _rolling(track.shape, turn, half, velocity, spin)
    spin *= min(1.0, FASTEST_SPIN / max(float(np.linalg.norm(spin)), 1e-9))
    start = start - velocity * first
    obj = replace(
        usual_object(track.shape, size_from_half(track.shape, half)),
        position=tuple(start),
        velocity=tuple(velocity),
        angular_velocity=tuple(spin),
        orientation=tuple(Rotation.from_matrix(turn).as_quat(scalar_first=True)),
    )
    bottom = reach_below(obj)
    z = bottom if grounded else max(float(start[2]), bottom)
    return replace(obj, position=(start[0], start[1], z))


def _first_turns(track: Registration) -> int:
    """How many intervals give the first angular velocity."""
    return int(np.searchsorted(track.times[1:], track.times[0] + TURN_SECONDS, side="right"))


def _spin_seen(track: Registration) -> bool:
    """Whether the first angular velocity is known, also about the axis of a cylinder."""
    return bool(track.turns_seen[: _first_turns(track)].any())


def _first_spin(track: Registration, view: Pinhole) -> np.ndarray:
    """(3,) rad/s, world frame, over the first frames."""
    turns = [
        Rotation.from_matrix(view.rotation_world @ track.turns[k] @ view.rotation_world.T).as_rotvec()
        / (track.times[k + 1] - track.times[k])
        for k in range(_first_turns(track))
        if track.turns_seen[k] or not _spin_seen(track)
    ]
    return np.mean(turns, 0) if turns else np.zeros(3)


def _stood(shape: str, rotation: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) to the world frame without a lean of less than `UPRIGHT`."""
    if shape == "sphere":
        return rotation
    axes = rotation.T[2]  # of the vertical along the body's axes
    for k in [2] if shape == "cylinder" else range(3):
        sign = np.sign(axes[k]) or 1.0
        if np.arccos(np.clip(abs(axes[k]), 0, 1)) < UPRIGHT:
            return _turn_onto(sign * rotation[:, k], np.array([0.0, 0.0, 1.0])) @ rotation
    if shape == "cylinder" and abs(np.arcsin(np.clip(axes[2], -1, 1))) < UPRIGHT:
        axis = rotation[:, 2]
        level = np.array([axis[0], axis[1], 0.0])
        return _turn_onto(axis, level / np.linalg.norm(level)) @ rotation
    return rotation


def _turn_onto(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that takes one unit vector (3,) to another, which is not its opposite."""
    cross = np.cross(source, target)
    skew = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    return np.eye(3) + skew + skew @ skew / (1 + float(source @ target))


def _rolling(shape: str, rotation: np.ndarray, half: np.ndarray, velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """The spin (3,) of a body on the ground: a sphere or a lying cylinder rolls, a standing body spins upright."""
    rolls = np.cross([0.0, 0.0, 1.0], velocity) / half[0]
    if shape == "sphere":
        return rolls
    axis = rotation[:, 2]
    if shape == "cylinder" and abs(axis[2]) < np.sin(UPRIGHT):
        return axis * float(axis @ rolls) + np.array([0.0, 0.0, spin[2]])
    along = np.abs(rotation.T[2])
    return np.array([0.0, 0.0, spin[2]]) if along.max() > np.cos(UPRIGHT) else spin
