"""Levenberg-Marquardt fit of one solid, with a pose of its own in each frame, to outlines. No physics.

Unknowns of a frame: the projected centre (px), the logarithm of its depth and, except for a sphere, a rotation vector.
Common to all frames: logarithms of the half extents and of the focal length. Priors keep what outlines do not tell:
velocities change little between frames, extents are alike, and focal length and depth are near their usual values.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.compiled import kernel
from pipeline.search.outlines.silhouette import DIRECTIONS, fill_distances, fill_support
from pipeline.vision.rendering.surface import CYLINDER, SPHERE

SIGMA_PX = 0.5  # px, standard deviation of the points of an outline
HUBER = 4.0  # standard deviations beyond which a point counts linearly
DEPTH_SPREAD = 0.3  # standard deviation of the logarithm of the depth
FOCAL_SPREAD = 0.15  # of the logarithm of the focal length
FOCAL_RANGE = 0.7  # most by which it may differ from the usual
EXTENT_SPREAD = 0.6  # of the logarithms of half extents about their mean
RECEDE = 0.3  # 1/s, standard deviation of changes of the relative velocity along the line of sight
SPIN = 1.0  # rad/s, of changes of the angular velocity
PREDICTED_DEPTH, PREDICTED_TURN = 0.01, 0.12  # of a tracked pose about its prediction: logarithm, rad
_STEP = 1e-5  # of finite differences: rad, and logarithms; in pixels a thousand times as much


@kernel
def turned(rotation: np.ndarray, x: float, y: float, z: float, out: np.ndarray) -> None:
    """Write the rotation (3, 3) after a turn by the rotation vector x, y, z (camera frame) into out (3, 3)."""
    angle = math.sqrt(x * x + y * y + z * z)
    s = math.sin(angle) / angle if angle > 1e-12 else 1.0
    c = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-12 else 0.5
    turn = np.empty((3, 3))
    turn[0, 0] = 1.0 - c * (y * y + z * z)
    turn[1, 1] = 1.0 - c * (x * x + z * z)
    turn[2, 2] = 1.0 - c * (x * x + y * y)
    turn[0, 1], turn[1, 0] = c * x * y - s * z, c * x * y + s * z
    turn[0, 2], turn[2, 0] = c * x * z + s * y, c * x * z - s * y
    turn[1, 2], turn[2, 1] = c * y * z - s * x, c * y * z + s * x
    for i in range(3):
        for j in range(3):
            out[i, j] = turn[i, 0] * rotation[0, j] + turn[i, 1] * rotation[1, j] + turn[i, 2] * rotation[2, j]


@kernel
def turn_between(first: np.ndarray, second: np.ndarray) -> tuple[float, float, float]:
    """The rotation vector of second firstᵀ, of an angle below pi."""
    m = second @ first.T
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (m[0, 0] + m[1, 1] + m[2, 2] - 1.0))
    scale = 0.5 * angle / sine if sine > 1e-9 else 0.5
    return x * scale, y * scale, z * scale


@kernel
def _support_at(
    kind: int, extents: np.ndarray, focal: float, pose: np.ndarray, rotation: np.ndarray, out: np.ndarray
) -> bool:
    """The support function (D,), in units of the focal length, of a pose: px, px, log m."""
    half, centre = np.empty(3), np.empty(3)
    half[0] = math.exp(extents[0])
    if kind == SPHERE:
        half[1] = half[2] = half[0]
    elif kind == CYLINDER:
        half[1], half[2] = half[0], math.exp(extents[1])
    else:
        half[1], half[2] = math.exp(extents[1]), math.exp(extents[2])
    depth = math.exp(pose[2])
    centre[0], centre[1], centre[2] = depth * pose[0] / focal, depth * pose[1] / focal, -depth
    return fill_support(kind, half, rotation, centre, out)


@kernel
def _robust(value: float) -> float:
    size = abs(value)
    return size * size if size <= HUBER else HUBER * (2 * size - HUBER)


@kernel
def _cost(kind: int, points: np.ndarray, free: np.ndarray, count: np.ndarray, times: np.ndarray, usual: np.ndarray,
          predicted: np.ndarray, predicted_turn: np.ndarray, use_predicted: bool, poses: np.ndarray,
          rotations: np.ndarray, extents: np.ndarray, focal: float, distance: np.ndarray,
          nearest: np.ndarray) -> tuple[float, float]:  # fmt: skip
    """The cost with priors, and of the outlines alone. Writes distances (K, P), and their normals."""
    support = np.empty(DIRECTIONS)
    data, prior = 0.0, 0.0
    frames = len(points)
    for k in range(frames):
        if not _support_at(kind, extents, focal, poses[k], rotations[k], support):
            return np.inf, np.inf
        fill_distances(points[k], count[k], focal, support, distance[k], nearest[k])
        for i in range(count[k]):
            if free[k, i] or distance[k, i] > 0:
                data += _robust(distance[k, i] / SIGMA_PX)
    sizes = len(extents)
    mean = extents.mean()
    for s in range(sizes):
        prior += ((extents[s] - mean) / EXTENT_SPREAD) ** 2
    prior += ((math.log(focal) - usual[1]) / FOCAL_SPREAD) ** 2
    if use_predicted:
        prior += ((poses[0, 2] - predicted[2]) / PREDICTED_DEPTH) ** 2
        if kind != SPHERE:
            x, y, z = turn_between(predicted_turn, rotations[0])
            prior += (x * x + y * y + z * z) / PREDICTED_TURN**2
    else:
        prior += ((poses[:, 2].mean() - usual[0]) / DEPTH_SPREAD) ** 2
    for k in range(1, frames - 1):
        before, after = times[k] - times[k - 1], times[k + 1] - times[k]
        change = (poses[k + 1, 2] - poses[k, 2]) / after - (poses[k, 2] - poses[k - 1, 2]) / before
        prior += (change / RECEDE) ** 2
        if kind != SPHERE:
            x0, y0, z0 = turn_between(rotations[k - 1], rotations[k])
            x1, y1, z1 = turn_between(rotations[k], rotations[k + 1])
            dx, dy, dz = x1 / after - x0 / before, y1 / after - y0 / before, z1 / after - z0 / before
            prior += (dx * dx + dy * dy + dz * dz) / SPIN**2
    return data + prior, data


@kernel
def refine(kind: int, points: np.ndarray, free: np.ndarray, count: np.ndarray, times: np.ndarray, usual: np.ndarray,
           predicted: np.ndarray, predicted_turn: np.ndarray, track: bool, poses: np.ndarray, rotations: np.ndarray,
           extents: np.ndarray, focal: float, iterations: int) -> tuple[float, float, float]:  # fmt: skip
    """Refine poses, extents and focal length in place.

    Args:
        kind: Code of a sphere, cylinder or box, from `surface.KINDS`.
        points: (K, P, 2) px, as in `Contour`.
        free: (K, P).
        count: (K,).
        times: (K,) s.
        usual: (2,) logarithms of the usual depth, m, and focal length, px.
        predicted: (3,) predicted pose, where `track`.
        predicted_turn: (3, 3) predicted rotation, where `track`.
        track: Keep extents and focal length, and the pose of the only frame near its prediction.
        poses: (K, 3) projected centre, px, and logarithm of the depth, m; changed in place.
        rotations: (K, 3, 3) from the body frame to the camera frame; changed in place.
        extents: (S,) logarithms of half extents, m, S = 1, 2, 3 for sphere, cylinder, box; changed in place.
        focal: px.
        iterations: Most steps.

    Returns:
        The cost, the part of it of the outlines, and the focal length.
    """
    frames, sizes = len(points), len(extents)
    each = 3 if kind == SPHERE else 6
    shared = 0 if track else sizes + 1
    total = frames * each + shared
    distance, nearest = np.zeros(points.shape[:2]), np.zeros(points.shape[:2], np.int64)
    new_distance, new_nearest = np.zeros(points.shape[:2]), np.zeros(points.shape[:2], np.int64)
    support = np.empty(DIRECTIONS)
    changes = np.empty((each + shared, DIRECTIONS))
    cost, data = _cost(kind, points, free, count, times, usual, predicted, predicted_turn, track, poses, rotations,
                       extents, focal, distance, nearest)  # fmt: skip
    if not np.isfinite(cost):
        return cost, data, focal
    damping, idle = 1e-2, 0
    trial_pose, trial_turn, trial_extents = np.empty(3), np.empty((3, 3)), np.empty(sizes)
    row = np.empty(each + shared)
    where = np.empty(each + shared, np.int64)
    for _ in range(iterations):
        matrix, gradient = np.zeros((total, total)), np.zeros(total)
        for k in range(frames):
            _support_at(kind, extents, focal, poses[k], rotations[k], support)
            for p in range(each + shared):
                trial_pose[:] = poses[k]
                trial_turn[:] = rotations[k]
                trial_extents[:] = extents
                trial_focal, step = focal, _STEP
                if p < 2:
                    step = 1000 * _STEP
                    trial_pose[p] += step
                elif p == 2:
                    trial_pose[2] += step
                elif p < each:
                    turned(rotations[k], step * (p == 3), step * (p == 4), step * (p == 5), trial_turn)
                elif p < each + sizes:
                    trial_extents[p - each] += step
                else:
                    trial_focal *= math.exp(step)
                _support_at(kind, trial_extents, trial_focal, trial_pose, trial_turn, changes[p])
                for d in range(DIRECTIONS):
                    changes[p, d] = -(trial_focal * changes[p, d] - focal * support[d]) / step / SIGMA_PX
                where[p] = k * each + p if p < each else frames * each + p - each
            for i in range(count[k]):
                if not free[k, i] and distance[k, i] <= 0:
                    continue
                value = distance[k, i] / SIGMA_PX
                weight = 1.0 if abs(value) <= HUBER else HUBER / abs(value)
                for p in range(each + shared):
                    row[p] = changes[p, nearest[k, i]]
                for p in range(each + shared):
                    scaled = weight * row[p]
                    gradient[where[p]] += scaled * value
                    for q in range(p + 1):
                        matrix[where[p], where[q]] += scaled * row[q]
        for i in range(total):
            for j in range(i):
                both = matrix[i, j] + matrix[j, i]
                matrix[i, j] = matrix[j, i] = both
        base = frames * each
        if not track:
            weight = 1.0 / EXTENT_SPREAD**2
            mean = extents.mean()
            for s in range(sizes):
                gradient[base + s] += weight * (extents[s] - mean)
                for t in range(sizes):
                    matrix[base + s, base + t] += weight * ((1.0 if s == t else 0.0) - 1.0 / sizes)
            gradient[base + sizes] += (math.log(focal) - usual[1]) / FOCAL_SPREAD**2
            matrix[base + sizes, base + sizes] += 1.0 / FOCAL_SPREAD**2
            weight = 1.0 / DEPTH_SPREAD**2
            mean = poses[:, 2].mean() - usual[0]
            for k in range(frames):
                gradient[k * each + 2] += weight * mean / frames
                for m in range(frames):
                    matrix[k * each + 2, m * each + 2] += weight / frames**2
        else:
            gradient[2] += (poses[0, 2] - predicted[2]) / PREDICTED_DEPTH**2
            matrix[2, 2] += 1.0 / PREDICTED_DEPTH**2
            if kind != SPHERE:
                x, y, z = turn_between(predicted_turn, rotations[0])
                weight = 1.0 / PREDICTED_TURN**2
                gradient[3] += weight * x
                gradient[4] += weight * y
                gradient[5] += weight * z
                for p in range(3, 6):
                    matrix[p, p] += weight
        for k in range(1, frames - 1):
            before, after = 1.0 / (times[k] - times[k - 1]), 1.0 / (times[k + 1] - times[k])
            parts = (before, -before - after, after)
            change = (poses[k + 1, 2] - poses[k, 2]) * after - (poses[k, 2] - poses[k - 1, 2]) * before
            for s in range(3):
                gradient[(k - 1 + s) * each + 2] += change * parts[s] / RECEDE**2
                for t in range(3):
                    matrix[(k - 1 + s) * each + 2, (k - 1 + t) * each + 2] += parts[s] * parts[t] / RECEDE**2
            if kind != SPHERE:
                first, second = (
                    turn_between(rotations[k - 1], rotations[k]),
                    turn_between(rotations[k], rotations[k + 1]),
                )
                for axis in range(3):
                    change = second[axis] * after - first[axis] * before
                    for s in range(3):
                        gradient[(k - 1 + s) * each + 3 + axis] += change * parts[s] / SPIN**2
                        for t in range(3):
                            at, to = (k - 1 + s) * each + 3 + axis, (k - 1 + t) * each + 3 + axis
                            matrix[at, to] += parts[s] * parts[t] / SPIN**2
        improved = False
        for _attempt in range(4):
            damped = matrix.copy()
            for i in range(total):
                damped[i, i] += damping * matrix[i, i] + 1e-6
            move = -np.linalg.solve(damped, gradient)
            new_poses, new_rotations, new_extents = poses.copy(), rotations.copy(), extents.copy()
            new_focal = focal
            for k in range(frames):
                for p in range(3):
                    new_poses[k, p] += move[k * each + p]
                if kind != SPHERE:
                    at = k * each + 3
                    turned(rotations[k], move[at], move[at + 1], move[at + 2], new_rotations[k])
            if not track:
                for s in range(sizes):
                    new_extents[s] += min(max(move[base + s], -0.7), 0.7)
                new_focal = math.log(focal) + min(max(move[base + sizes], -0.3), 0.3)
                new_focal = math.exp(min(max(new_focal, usual[1] - FOCAL_RANGE), usual[1] + FOCAL_RANGE))
            new_cost, new_data = _cost(kind, points, free, count, times, usual, predicted, predicted_turn, track,
                                       new_poses, new_rotations, new_extents, new_focal, new_distance,
                                       new_nearest)  # fmt: skip
            if new_cost < cost:
                idle = idle + 1 if new_cost > 0.998 * cost else 0
                cost, data, focal = new_cost, new_data, new_focal
                poses[:], rotations[:], extents[:] = new_poses, new_rotations, new_extents
                distance[:], nearest[:] = new_distance, new_nearest
                damping = max(damping * 0.2, 1e-6)
                improved = True
                break
            damping = min(damping * 8, 1e6)
        if not improved or idle >= 2:
            break
    return cost, data, focal
