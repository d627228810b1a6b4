"""A body that turns freely in the air: its shape, size, first orientation and spin, from solids registered to outlines.

Each frame's outline gives an orientation; Euler's equations without torque join them (Goldstein, "Classical mechanics",
chapter 5), so that what single outlines leave open follows from all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.scene.scene import size_from_half
from pipeline.scene.solid import unit_inertia
from pipeline.search.outlines.contour import instance_contour
from pipeline.search.outlines.registration import Registration
from pipeline.search.outlines.shape_evidence import shape_evidence
from pipeline.vision.rendering.camera import pinhole
from pipeline.worlds.plane import Plane

STEP = 1 / 120  # s, longest step of the integration
SOFT = 0.2  # rad, of an orientation's error, from which it counts less
FIRST_TURNS = 5  # that give the spin from which the fit starts
LEAST_FRAMES = 4


@dataclass(frozen=True)
class Tumbling:
    """A body in the air.

    Attributes:
        shape: sphere, cylinder or box.
        size: px at the plane, full lengths as a scene object has them.
        orientation: (4,) quaternion at time 0, from the body to the world.
        spin: (3,) rad/s at time 0, world frame.
    """

    shape: str
    size: tuple[float, ...]
    orientation: np.ndarray
    spin: np.ndarray


def tumbling(
    track: ImageTrack, flat: ImageTrack, masks: np.ndarray, times: np.ndarray, plane: Plane
) -> Tumbling | None:
    """The body of a track; None where too few frames show its outline.

    Args:
        track: Of the body.
        flat: The same in the picture of the plane.
        masks: (T, H, W) ids.
        times: (T,) s.
        plane: In which its centre moves.
    """
    view, focal = pinhole(plane.camera()), plane.focal
    contour = instance_contour(np.where(masks == track.body, np.uint8(1), np.uint8(0)), 0)
    if len(contour.frames) < LEAST_FRAMES:
        return None
    evidence = shape_evidence(contour, np.asarray(times, float), focal, view.rotation_world.T)
    found = evidence.registrations[evidence.ranked[0]]
    size = np.median(found.focal / np.exp(found.poses[:, 2])) * found.half * flat.radius / track.radius
    own = view.rotation_world @ aligned_with_sight(found, focal)
    first, spin = free_rotation_through(found.shape, size, own, found.times)
    orientation = first.as_quat(canonical=True, scalar_first=True)
    return Tumbling(found.shape, size_from_half(found.shape, size), orientation, spin)


def aligned_with_sight(found: Registration, focal: float) -> np.ndarray:
    """(K, 3, 3) rotations of a registration, turned so that a camera of another focal length, px, sees the same."""
    out = []
    for pose, rotation in zip(found.poses, found.rotations, strict=True):
        rays = [np.array([pose[0], pose[1], -f]) / np.linalg.norm([pose[0], pose[1], f]) for f in (found.focal, focal)]
        out.append(Rotation.align_vectors(rays[1][None], rays[0][None])[0].as_matrix() @ rotation)
    return np.array(out)


def free_rotation_through(
    shape: str, half: np.ndarray, rotations: np.ndarray, times: np.ndarray
) -> tuple[Rotation, np.ndarray]:
    """Orientation and spin (3,) at time 0 of the free rotation that passes through orientations.

    Args:
        shape: Of the body: of a cylinder, only the axis counts, of a sphere nothing.
        half: (3,) half extents in any unit.
        rotations: (K, 3, 3) from the body to the world.
        times: (K,) s.
    """
    if shape == "sphere" or len(times) < 2:
        return Rotation.identity(), np.zeros(3)
    inertia = unit_inertia(shape, np.asarray(half, float)[None], np.zeros(1))[0]
    measured = Rotation.from_matrix(rotations)
    turns = (measured[1:] * measured[:-1].inv()).as_rotvec() / np.diff(times)[:, None]
    start = np.concatenate([measured[0].as_rotvec(), np.median(turns[:FIRST_TURNS], axis=0)])

    def off(x: np.ndarray) -> np.ndarray:
        path = free_rotation(inertia, Rotation.from_rotvec(x[:3]), x[3:], times - times[0])
        if shape == "cylinder":
            return np.asarray((path.as_matrix()[:, :, 2] - rotations[:, :, 2]).ravel() / SOFT)
        return np.asarray((path.inv() * measured).as_rotvec().ravel() / SOFT)

    x = least_squares(off, start, loss="soft_l1", max_nfev=40).x
    first, spin = Rotation.from_rotvec(x[:3]), x[3:]
    if times[0] > 0:
        first = Rotation.from_rotvec(-times[0] * spin) * first
    return first, spin


def free_rotation(inertia: np.ndarray, first: Rotation, spin: np.ndarray, times: np.ndarray) -> Rotation:
    """Orientations at times (K,), s, from 0, of a body without torque.

    Args:
        inertia: (3,) about its own axes, in any unit.
        first: Orientation at time 0, from the body to the world.
        spin: (3,) rad/s at time 0, world frame.
        times: (K,) increasing.
    """
    own, turn, now, out = first.inv().apply(spin), first, 0.0, []
    for time in times:
        count = int(np.ceil((time - now) / STEP - 1e-9))
        step = (time - now) / max(count, 1)
        for _ in range(count):
            middle = own + 0.5 * step * _acceleration(inertia, own)
            own = own + step * _acceleration(inertia, middle)
            turn = turn * Rotation.from_rotvec(step * middle)
        now = time
        out.append(turn.as_quat())
    return Rotation.from_quat(out)


def _acceleration(inertia: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """(3,) rad/s² of a free body, in its own frame."""
    return np.asarray(-np.cross(spin, inertia * spin) / inertia)
