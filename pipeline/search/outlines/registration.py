"""A solid registered to the outlines of one instance: sizes and a pose in each frame, without physics or ground.

A fit to the frame that shows the instance best begins at several orientations. The best of them are tracked through all
frames and then refined in several frames at once, with common sizes. One camera does not tell the scale: the depth is
near a usual one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.search.outlines.contour import Contour
from pipeline.search.outlines.refine import refine, turn_between, turned
from pipeline.vision.rendering.surface import KINDS

USUAL_DEPTH = 2.3  # m
KEPT = 3  # of the starts, that are tracked
SINGLE_STEPS, TRACK_STEPS, JOINT_STEPS = 15, 4, 25  # most steps of each fit
LEANING_COST, LEANING = 100.0, np.radians(25.0)  # cost of a body that leans, and the lean at which it sets in, rad
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
        times: (K,) s, of these frames.
        poses: (K, 3) projected centre, px from the centre of the image, and logarithm of the depth, m.
        rotations: (K, 3, 3) from the body frame.
        cost: Of the outlines at the frames fitted at once, squares in units of `refine.SIGMA_PX`, with linear tails.
        points: How many points that cost has.
        turns: (K - 1, 3, 3) rotation from a frame to the next, camera frame.
        turns_seen: (K - 1,) whether that is known. Outlines do not show how a round body turns.
    """

    shape: str
    extents: np.ndarray
    focal: float
    frames: np.ndarray
    times: np.ndarray
    poses: np.ndarray
    rotations: np.ndarray
    cost: float
    points: int
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


def spread_frames(contour: Contour) -> np.ndarray:
    """At most MOST_FRAMES positions of a contour's frames: evenly spread, of those that show the body's own outline."""
    own = contour.free.sum(1)
    good = np.flatnonzero(own >= max(8, 0.5 * own.max(initial=0)))
    if not len(good):
        good = np.arange(len(own))
    return good[np.unique(np.linspace(0, len(good) - 1, min(MOST_FRAMES, len(good))).round().astype(int))]


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
    job = _Job(contour, times[contour.frames], shape, focal)
    own = contour.free.sum(1)
    anchor = int(np.argmax((own / np.maximum(contour.count, 1)) ** 2 * contour.area))
    singles = []
    for rotation in start_orientations(shape, upright):
        single = job.fitted(job.start(anchor, rotation), np.array([anchor]), SINGLE_STEPS)
        singles.append((single.cost + lean_cost(shape, single.rotations[0], upright), single))
    singles.sort(key=lambda pair: pair[0])
    at, joint = spread_frames(contour), []
    for single in distinct([single for _, single in singles])[:KEPT]:
        tracked = job.tracked(single, anchor)
        fit = job.fitted(replace(tracked, poses=tracked.poses[at], rotations=tracked.rotations[at]), at, JOINT_STEPS)
        leaning = float(np.mean([lean_cost(shape, turn, upright) for turn in fit.rotations]))
        joint.append((fit.cost + leaning, fit))
    _, best = min(joint, key=lambda pair: pair[0])
    first = int(np.argmin(np.abs(at - anchor)))
    one = replace(best, poses=best.poses[[first]], rotations=best.rotations[[first]])
    whole = job.tracked(one, int(at[first]))
    return Registration(
        shape=shape,
        extents=np.exp(best.extents),
        focal=best.focal,
        frames=contour.frames,
        times=job.times,
        poses=whole.poses,
        rotations=whole.rotations,
        cost=best.outline_cost,
        points=int(contour.free[at].sum()),
        turns=whole.rotations[1:] @ whole.rotations[:-1].transpose(0, 2, 1),
        turns_seen=np.zeros(max(len(whole.poses) - 1, 0), bool),
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


@dataclass(frozen=True)
class _Fit:
    """poses (K, 3), rotations (K, 3, 3), logarithms of extents (S,), focal (px), cost with priors and of outlines."""

    poses: np.ndarray
    rotations: np.ndarray
    extents: np.ndarray
    focal: float
    cost: float = np.inf
    outline_cost: float = np.inf


def distinct(fits: list[_Fit]) -> list[_Fit]:
    """The fits without those that have the sizes and the cost of one before them."""
    kept: list[_Fit] = []
    for fit in fits:
        if not any(abs(fit.cost - k.cost) < 0.5 and np.allclose(fit.extents, k.extents, atol=0.05) for k in kept):
            kept.append(fit)
    return kept


@dataclass(frozen=True)
class _Job:
    """A contour in K frames, their times (K,) s, a shape to fit to it, and the usual focal length, px."""

    contour: Contour
    times: np.ndarray
    shape: str
    focal: float

    def start(self, anchor: int, rotation: np.ndarray) -> _Fit:
        """A body at the usual depth, as large as its outline in one frame, with a given rotation (3, 3)."""
        contour = self.contour
        middle = contour.points[anchor, : contour.count[anchor]].mean(0)
        radius = FULL[self.shape] * np.sqrt(contour.area[anchor] / np.pi) * USUAL_DEPTH / self.focal
        poses = np.array([[*middle, np.log(USUAL_DEPTH)]])
        return _Fit(poses, rotation[None], np.full(SIZES[self.shape], np.log(radius)), self.focal)

    def fitted(self, fit: _Fit, at: np.ndarray, steps: int, predicted: bool = False) -> _Fit:
        """The fit after refinement in some frames.

        Args:
            fit: Poses and rotations of those frames.
            at: (L,) positions of the frames in the contour.
            steps: Most steps.
            predicted: Keep extents and focal length, and the pose of the only frame near that of `fit`.
        """
        contour = self.contour
        poses, rotations, extents = fit.poses.copy(), fit.rotations.copy(), fit.extents.copy()
        cost, outline_cost, focal = refine(
            KINDS[self.shape],
            contour.points[at],
            contour.free[at],
            contour.count[at],
            self.times[at],
            np.log([USUAL_DEPTH, self.focal]),
            fit.poses[0].copy(),
            fit.rotations[0].copy(),
            predicted,
            poses,
            rotations,
            extents,
            fit.focal,
            steps,
        )
        return _Fit(poses, rotations, extents, focal, cost, outline_cost)

    def tracked(self, fit: _Fit, anchor: int) -> _Fit:
        """Poses and rotations in all frames, with the sizes of a fit to one frame."""
        contour, count = self.contour, len(self.times)
        poses, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
        poses[anchor], rotations[anchor] = fit.poses[0], fit.rotations[0]
        middle = np.array([p[:n].mean(0) for p, n in zip(contour.points, contour.count, strict=True)])
        for direction in (1, -1):
            spin, recede, last = np.zeros(3), 0.0, anchor
            k = anchor + direction
            while 0 <= k < count:
                step = float(self.times[k] - self.times[last])
                pose, turn = poses[last].copy(), np.empty((3, 3))
                pose[:2] += middle[k] - middle[last]
                pose[2] += recede * step
                turned(rotations[last], spin[0] * step, spin[1] * step, spin[2] * step, turn)
                near = replace(fit, poses=pose[None], rotations=turn[None])
                found = self.fitted(near, np.array([k]), TRACK_STEPS, predicted=True)
                poses[k], rotations[k] = found.poses[0], found.rotations[0]
                spin = 0.5 * spin + 0.5 * np.array(turn_between(rotations[last], rotations[k])) / step
                recede = 0.5 * recede + 0.5 * float(poses[k, 2] - poses[last, 2]) / step
                last, k = k, k + direction
        return replace(fit, poses=poses, rotations=rotations)
