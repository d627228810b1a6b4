"""A solid registered to the outlines of one instance: sizes and a pose in each frame, without physics or ground.

A fit to the frame that shows the instance best begins at several orientations. The best of them are tracked through all
frames and then refined in several frames at once, with common sizes. One camera does not tell the scale: the depth is
near a usual one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.search.outlines.contour import Contour
from pipeline.search.outlines.refine import refine, turn_between, turned
from pipeline.search.outlines.silhouette import NORMALS
from pipeline.vision.rendering.surface import KINDS

USUAL_DEPTH = 2.3  # m
SIGMA_PX = 0.5  # px, standard deviation of the points of an outline
KEPT = 3  # of the starts, that are tracked
SINGLE_STEPS, TRACK_STEPS, JOINT_STEPS = 15, 4, 25  # most steps of each fit
LEANING_COST, LEANING = 100.0, np.radians(12.0)
MOST_FRAMES = 12  # frames that are fitted at once
SIZES = {"sphere": 1, "cylinder": 2, "box": 3}
FULL = {"sphere": 1.0, "cylinder": 0.8, "box": 0.75}  # half extents at the start over the radius of the outline


@dataclass(frozen=True)
class Registration:
    """One shape fitted to one instance, in the camera frame (right, up, back).

    Attributes:
        shape: The shape.
        extents: (S,) half extents, m: radius; radius and half height; three of a box.
        focal: Focal length, px.
        frames: (K,) indices of the clip's frames in which it was fitted.
        poses: (K, 3) projected centre, px from the centre of the image, and logarithm of the depth, m.
        rotations: (K, 3, 3) from the body frame.
        cost: Of the outlines at the frames fitted at once, squares in units of `SIGMA_PX`, with linear tails.
        points: How many points that cost has.
        fitted: (L,) positions in `frames` of the frames fitted at once.
        turns: (K - 1, 3, 3) rotation from a frame to the next, camera frame.
        turns_seen: (K - 1,) whether that is known. Outlines do not show how a round body turns.
    """

    shape: str
    extents: np.ndarray
    focal: float
    frames: np.ndarray
    poses: np.ndarray
    rotations: np.ndarray
    cost: float
    points: int
    fitted: np.ndarray
    turns: np.ndarray
    turns_seen: np.ndarray

    @property
    def half(self) -> np.ndarray:
        """(3,) half extents along the body's axes, m."""
        return {1: self.extents[[0, 0, 0]], 2: self.extents[[0, 0, -1]], 3: self.extents}[len(self.extents)]

    @property
    def centres(self) -> np.ndarray:
        """(K, 3) m."""
        depth = np.exp(self.poses[:, 2])
        return np.stack([depth * self.poses[:, 0] / self.focal, depth * self.poses[:, 1] / self.focal, -depth], 1)


def spread_frames(contour: Contour, most: int = MOST_FRAMES) -> np.ndarray:
    """Positions of at most `most` frames of a contour: evenly spread, of those that show the body's own outline."""
    own = contour.free.sum(1)
    good = np.flatnonzero(own >= max(8, 0.5 * own.max(initial=0)))
    if not len(good):
        good = np.arange(len(own))
    return good[np.unique(np.linspace(0, len(good) - 1, min(most, len(good))).round().astype(int))]


def start_orientations(shape: str, upright: np.ndarray) -> np.ndarray:
    """(S, 3, 3) rotations from the body frame to the camera frame from which a fit starts.

    upright: (3, 3) from the world frame (z up) to the camera frame, as far as it is known.
    """
    if shape == "sphere":
        return upright[None]
    world = []
    if shape == "cylinder":
        world.append(np.eye(3))
        world += [_rotation_z(yaw) @ _rotation_y(np.pi / 2) for yaw in np.pi / 4 * np.arange(4)]
        world += [_rotation_z(yaw) @ _rotation_y(np.pi / 4) for yaw in np.pi / 2 * np.arange(4)]
    else:
        world += [_rotation_z(yaw) for yaw in np.pi / 8 * np.arange(4)]
        world += [_rotation_z(yaw) @ _rotation_y(np.pi / 4) for yaw in np.pi / 4 * np.arange(8)]
        world += [_rotation_z(yaw) @ _rotation_y(0.9553) @ _rotation_z(np.pi / 4) for yaw in np.pi / 3 * np.arange(2)]
    return np.array([upright @ w for w in world])


def _rotation_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation_y(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def register(contour: Contour, shape: str, times: np.ndarray, focal: float, upright: np.ndarray) -> Registration:
    """The best fit of a shape to the outlines of an instance.

    Args:
        contour: The outlines, of at least one frame.
        shape: sphere, cylinder or box.
        times: (F,) of the clip's frames, s.
        focal: Usual focal length, px.
        upright: (3, 3) from the world frame (z up) to the camera frame, as far as it is known.
    """
    kind, usual = KINDS[shape], np.log([USUAL_DEPTH, focal])
    when = times[contour.frames]
    own = contour.free.sum(1)
    anchor = int(np.argmax((own / np.maximum(contour.count, 1)) ** 2 * contour.area))
    singles = []
    for rotation in start_orientations(shape, upright):
        middle = contour.points[anchor, : contour.count[anchor]].mean(0)
        radius = FULL[shape] * np.sqrt(contour.area[anchor] / np.pi) * USUAL_DEPTH / focal
        poses, rotations = np.array([[*middle, usual[0]]]), rotation[None].copy()
        extents = np.full(SIZES[shape], np.log(radius))
        cost, _, found = _fit(contour, [anchor], when, kind, usual, poses, rotations, extents, focal, SINGLE_STEPS)
        singles.append((cost + lean_cost(shape, rotations[0], upright), poses[0], rotations[0], extents, found))
    singles.sort(key=lambda single: single[0])
    joint = []
    fitted = spread_frames(contour)
    for _, pose, rotation, extents, found in singles[:KEPT]:
        poses, rotations = track(contour, anchor, when, kind, pose, rotation, extents, found)
        some, turns = poses[fitted], rotations[fitted]
        cost, data, found = _fit(contour, fitted, when, kind, usual, some, turns, extents, found, JOINT_STEPS)
        leaning = float(np.mean([lean_cost(shape, turn, upright) for turn in turns]))
        joint.append((cost + leaning, data, some, turns, extents, found))
    _, data, some, turns, extents, found = min(joint, key=lambda fit: fit[0])
    first = int(np.argmin(np.abs(fitted - anchor)))
    poses, rotations = track(contour, int(fitted[first]), when, kind, some[first], turns[first], extents, found)
    points = int(contour.free[fitted].sum())
    return Registration(
        shape=shape,
        extents=np.exp(extents),
        focal=found,
        frames=contour.frames,
        poses=poses,
        rotations=rotations,
        cost=data,
        points=points,
        fitted=fitted,
        turns=rotations[1:] @ rotations[:-1].transpose(0, 2, 1),
        turns_seen=np.zeros(max(len(poses) - 1, 0), bool),
    )


def lean_cost(shape: str, rotation: np.ndarray, upright: np.ndarray) -> float:
    """The cost of a body that neither stands on a face nor lies on its side, at most `LEANING_COST`.

    Without perspective, a cylinder or box has the outline of another one that leans the other way. Most bodies stand.

    Args:
        shape: The shape.
        rotation: (3, 3) from the body frame to the camera frame.
        upright: (3, 3) from the world frame to the camera frame, as far as it is known.
    """
    if shape == "sphere":
        return 0.0
    along = np.clip(np.abs(rotation.T @ upright[:, 2]), 0, 1)
    lean = np.arccos(along.max())
    if shape == "cylinder":
        lean = min(np.arccos(along[2]), np.arcsin(along[2]))
    return float(LEANING_COST * (1 - np.exp(-((lean / LEANING) ** 2))))


def _fit(contour, at, when, kind, usual, poses, rotations, extents, focal, steps):  # type: ignore[no-untyped-def]
    at = np.asarray(at)
    return refine(kind, contour.points[at], contour.free[at], contour.count[at], when[at], SIGMA_PX, usual,
                  poses[0], rotations[0].copy(), False, NORMALS, poses, rotations, extents, focal, steps)  # fmt: skip


def track(contour, anchor, when, kind, pose, rotation, extents, focal):  # type: ignore[no-untyped-def]
    """Poses (K, 3) and rotations (K, 3, 3) in all frames, with given sizes, from those of one frame."""
    count = len(contour.frames)
    poses, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    usual = np.zeros(2)
    poses[anchor], rotations[anchor] = pose, rotation
    for direction in (1, -1):
        spin, recede, last = np.zeros(3), 0.0, anchor
        k = anchor + direction
        while 0 <= k < count:
            step = when[k] - when[last]
            predicted, turn = poses[last].copy(), np.empty((3, 3))
            predicted[:2] += (contour.points[k, : contour.count[k]].mean(0)
                              - contour.points[last, : contour.count[last]].mean(0))  # fmt: skip
            predicted[2] += recede * step
            turned(rotations[last], *(spin * step), turn)
            here, there = predicted[None].copy(), turn[None].copy()
            one = np.array([k])
            refine(kind, contour.points[one], contour.free[one], contour.count[one], when[one], SIGMA_PX, usual,
                   predicted, turn, True, NORMALS, here, there, extents, focal, TRACK_STEPS)  # fmt: skip
            spin = 0.5 * spin + 0.5 * np.array(turn_between(rotations[last], there[0])) / step
            recede = 0.5 * recede + 0.5 * (here[0, 2] - poses[last, 2]) / step
            poses[k], rotations[k] = here[0], there[0]
            last, k = k, k + direction
    return poses, rotations
