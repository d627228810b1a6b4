"""How a round body turns, from its texture: outlines show a sphere's place, but not its rotation.

The surface of a registered sphere or cylinder is turned by a candidate rotation from one frame to the next and compared
with the picture there, by the correlation of what remains of the colours after smooth shading is removed. A sphere has
three unknowns, a cylinder one, the rotation about its axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.compiled import kernel
from pipeline.search.guess import CAMERA
from pipeline.search.outlines.registration import Registration
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.surface import CYLINDER, KINDS, intersect, normal

WINDOW = 5  # successive intervals that share an angular velocity
POINTS = 120  # of the surface that are compared, for each interval
LEAST_POINTS = 25
FACING = 0.3  # least cosine between the normal and the line of sight of a point that is compared
FASTEST = 0.75  # rad per interval, reach of the coarse search
SEARCH_EVERY = 3  # intervals, where the rotation before is not known
COARSE = 0.15  # rad, its step
STEADY = 0.05  # rad, spread of the turns of a box over a window, up to which its outline shows them
FINE = 0.01  # rad, the last step of the refinement
TRUSTED = 0.6  # least correlation of a rotation that counts as seen
LEAST_SEEN = 0.5  # share of the intervals with such a rotation; the others take the nearest one
ROLLING_SHARE = 0.9  # of the largest correlation, from which a rotation like that of rolling is preferred
BINS = 8  # across the body, of the pattern that stays at its place while the body turns: shading and highlights
USUAL_UP = np.ascontiguousarray(pinhole(CAMERA).rotation_world[2])  # in the camera frame


@kernel
def fill_surface(kind: int, half: np.ndarray, rotation: np.ndarray, centre: np.ndarray, pixels: np.ndarray,
                 focal: float, facing: float, points: np.ndarray, normals: np.ndarray,
                 seen: np.ndarray) -> None:  # fmt: skip
    """Surface points of a body at pixels, relative to its centre and in the directions of the camera frame.

    Args:
        kind: Code of the shape.
        half: (3,) m.
        rotation: (3, 3) from the body frame to the camera frame.
        centre: (3,) m.
        pixels: (P, 2) px from the centre of the image, right and up.
        focal: px.
        facing: Least cosine between normal and line of sight.
        points: Output (P, 3) m.
        normals: Output (P, 3).
        seen: Output (P,) whether the ray meets the body, with a normal that faces the camera.
    """
    origin = rotation.T @ (-centre)
    ray = np.empty(3)
    for i in range(len(pixels)):
        ray[0], ray[1], ray[2] = pixels[i, 0] / focal, pixels[i, 1] / focal, -1.0
        d = rotation.T @ ray
        t = intersect(kind, half[0], half[1], half[2], origin[0], origin[1], origin[2], d[0], d[1], d[2])
        seen[i] = np.isfinite(t)
        if not seen[i]:
            continue
        p = origin + t * d
        n = np.empty(3)
        n[0], n[1], n[2] = normal(kind, half[0], half[1], half[2], p[0], p[1], p[2])
        points[i] = rotation @ p
        normals[i] = rotation @ n
        seen[i] = -(normals[i] @ ray) / math.sqrt(ray @ ray) > facing


@kernel
def about(vectors: np.ndarray, angle: float) -> np.ndarray:
    """(L, 3, 3) rotations by `angle` times vectors (L, 3), by Rodrigues' formula."""
    out = np.empty((len(vectors), 3, 3))
    for k in range(len(vectors)):
        x, y, z = angle * vectors[k, 0], angle * vectors[k, 1], angle * vectors[k, 2]
        square = x * x + y * y + z * z
        size = math.sqrt(square)
        s = math.sin(size) / size if size > 0 else 1.0
        half = math.sin(0.5 * size) / (0.5 * size) if size > 0 else 1.0
        c = 0.5 * half * half
        out[k, 0, 0], out[k, 0, 1], out[k, 0, 2] = 1 - c * (square - x * x), c * x * y - s * z, c * x * z + s * y
        out[k, 1, 0], out[k, 1, 1], out[k, 1, 2] = c * x * y + s * z, 1 - c * (square - y * y), c * y * z - s * x
        out[k, 2, 0], out[k, 2, 1], out[k, 2, 2] = c * x * z - s * y, c * y * z + s * x, 1 - c * (square - z * z)
    return out


@kernel
def correlation(turns: np.ndarray, points: np.ndarray, normals: np.ndarray, values: np.ndarray, count: np.ndarray,
                centres: np.ndarray, pictures: np.ndarray, inside: np.ndarray, focal: float) -> float:  # fmt: skip
    """Correlation of surface values with those of the next pictures after each interval's turn; -1 where too few meet.

    Args:
        turns: (L, 3, 3).
        points: (L, P, 3) m, relative to the body's centre.
        normals: (L, P, 3).
        values: (L, P) in the first picture of each interval.
        count: (L,) number of points.
        centres: (L, 3) m, in the second picture.
        pictures: (L, H, W) the second pictures.
        inside: (L, H, W) whether a pixel shows the body there.
        focal: px.
    """
    height, width = pictures.shape[1:]
    n, sa, sb, saa, sbb, sab = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    total = 0
    for k in range(len(turns)):
        m = turns[k]
        for i in range(count[k]):
            total += 1
            p, q = points[k, i], normals[k, i]
            x = m[0, 0] * p[0] + m[0, 1] * p[1] + m[0, 2] * p[2] + centres[k, 0]
            y = m[1, 0] * p[0] + m[1, 1] * p[1] + m[1, 2] * p[2] + centres[k, 1]
            z = m[2, 0] * p[0] + m[2, 1] * p[1] + m[2, 2] * p[2] + centres[k, 2]
            nx = m[0, 0] * q[0] + m[0, 1] * q[1] + m[0, 2] * q[2]
            ny = m[1, 0] * q[0] + m[1, 1] * q[1] + m[1, 2] * q[2]
            nz = m[2, 0] * q[0] + m[2, 1] * q[1] + m[2, 2] * q[2]
            if -(nx * x + ny * y + nz * z) < FACING * math.sqrt(x * x + y * y + z * z):
                continue
            column = 0.5 * width - focal * x / z - 0.5
            row = 0.5 * height + focal * y / z - 0.5
            if not (0 <= column < width - 1 and 0 <= row < height - 1):
                continue
            c, r = int(column), int(row)
            if not (inside[k, r, c] and inside[k, r + 1, c] and inside[k, r, c + 1] and inside[k, r + 1, c + 1]):
                continue
            a, b = column - c, row - r
            v = (1 - b) * ((1 - a) * pictures[k, r, c] + a * pictures[k, r, c + 1]) + b * (
                (1 - a) * pictures[k, r + 1, c] + a * pictures[k, r + 1, c + 1]
            )
            u = values[k, i]
            n += 1
            sa += u
            sb += v
            saa += u * u
            sbb += v * v
            sab += u * v
    if n < LEAST_POINTS or n < 0.3 * total:
        return -1.0
    va, vb = saa - sa * sa / n, sbb - sb * sb / n
    if va <= 1e-12 or vb <= 1e-12:
        return -1.0
    return (sab - sa * sb / n) / math.sqrt(va * vb)


def with_seen_turns(found: Registration, masks: np.ndarray, instance: int, frames: np.ndarray) -> Registration:
    """The registration with the rotation that the body's texture shows.

    Args:
        found: The registration, in every frame in which the instance is seen.
        masks: (F, H, W) of the clip.
        instance: Counted from 0.
        frames: (F, h, w, 3) uint8, pictures of the clip, of any size.
    """
    count = len(found.frames)
    surface = _Surface(found, masks, instance, frames)
    successive = [k for k in range(count - 1) if found.frames[k + 1] == found.frames[k] + 1]
    if found.shape == "box":
        return _box_turns(found, surface, successive)
    turns: dict[int, np.ndarray] = {}
    last: np.ndarray | None = None
    for k in successive:
        window = [j for j in successive if abs(j - k) <= WINDOW // 2]
        if last is None and k % SEARCH_EVERY:
            continue
        best, score = surface.best_turn(window, k, last)
        last = best if score >= TRUSTED else None
        if last is not None:
            turns[k] = last
    if len(turns) < LEAST_SEEN * max(count - 1, 1):
        return found
    known = np.array(sorted(turns))
    nearest = [int(known[np.argmin(np.abs(known - k))]) for k in range(count - 1)]
    matrices = np.array([surface.turns([k], turns[j])[0] for k, j in enumerate(nearest)])
    return replace(found, turns=matrices, turns_seen=np.full(count - 1, True))


def _box_turns(found: Registration, surface: _Surface, successive: list[int]) -> Registration:
    """The box with the turns of its outlines, where these are steady, else with those that its texture shows."""
    vectors = Rotation.from_matrix(found.turns.reshape(-1, 3, 3)).as_rotvec() if len(found.turns) else np.zeros((0, 3))
    turns, seen = vectors.copy(), np.zeros(len(vectors), bool)
    for k in successive:
        window = [j for j in successive if abs(j - k) <= WINDOW // 2]
        middle = np.median(vectors[window], 0)
        spread = float(np.median(np.linalg.norm(vectors[window] - middle, axis=1)))
        if spread < STEADY:
            seen[k] = True
            continue
        best, score = surface.refined_turn(window, middle)
        turns[k], seen[k] = best, score >= TRUSTED
    return replace(found, turns=Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix(), turns_seen=seen)


class _Surface:
    """The surface of a registered sphere or cylinder, as pictures show it."""

    def __init__(self, found: Registration, masks: np.ndarray, instance: int, frames: np.ndarray) -> None:
        height, width = frames.shape[1:3]
        self._found, self._focal = found, found.focal * width / masks.shape[2]
        self._kind, self._half = KINDS[found.shape], np.ascontiguousarray(found.half)
        own = (masks[found.frames] == instance + 1).astype(np.uint8)
        small = np.stack([cv2.resize(m, (width, height), interpolation=cv2.INTER_NEAREST_EXACT) for m in own])
        self._inside = np.stack([cv2.erode(m, np.ones((3, 3), np.uint8)) for m in small]).astype(bool)
        self._centres = found.centres
        self._axes = found.rotations[:, :, 2]
        samples = [self._sample(k) for k in range(len(own))]
        self._points = [p for p, _, _ in samples]
        self._normals = [n for _, n, _ in samples]
        self._pictures = self._without_shading(frames[found.frames], [p for _, _, p in samples])
        self._values = [
            picture[at[:, 0], at[:, 1]] for picture, (_, _, at) in zip(self._pictures, samples, strict=True)
        ]

    def _sample(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (P, 3), normals (P, 3), and rows and columns (P, 2) of the pixels that show them."""
        height, width = self._inside.shape[1:]
        at = np.argwhere(self._inside[k])
        if len(at) > 4 * POINTS:
            at = at[np.linspace(0, len(at) - 1, 4 * POINTS).round().astype(int)]
        pixels = np.stack([at[:, 1] + 0.5 - width / 2, height / 2 - at[:, 0] - 0.5], 1)
        points, normals, seen = np.zeros((len(at), 3)), np.zeros((len(at), 3)), np.zeros(len(at), bool)
        fill_surface(self._kind, self._half, np.ascontiguousarray(self._found.rotations[k]), self._centres[k], pixels,
                     self._focal, FACING, points, normals, seen)  # fmt: skip
        return points[seen], normals[seen], at[seen]

    def _without_shading(self, frames: np.ndarray, at: list[np.ndarray]) -> np.ndarray:
        """Pictures (K, h, w): the colours along their main direction, less what depends on the normal alone.

        at: for each frame the pixels (P, 2) that show the surface.
        """
        colours = np.concatenate([f[p[:, 0], p[:, 1]] for f, p in zip(frames, at, strict=True)]).astype(np.float64)
        if len(colours) < 10:
            return np.zeros(frames.shape[:3], np.float32)
        _, vectors = np.linalg.eigh(np.cov(colours.T))
        values = colours @ vectors[:, -1]
        normals = np.concatenate(self._normals)
        fit, *_ = np.linalg.lstsq(_quadratic(normals), values, rcond=None)
        rest = values - _quadratic(normals) @ fit
        number = np.bincount(_bin(normals), minlength=BINS**2)
        still = np.bincount(_bin(normals), rest, minlength=BINS**2) / np.maximum(number, 1)
        pictures = np.zeros(frames.shape[:3], np.float32)
        for k, frame in enumerate(frames):
            rows, columns = np.nonzero(self._inside[k])
            if not len(rows):
                continue
            height, width = frames.shape[1:3]
            pixels = np.stack([columns + 0.5 - width / 2, height / 2 - rows - 0.5], 1)
            points, normals, seen = np.zeros((len(rows), 3)), np.zeros((len(rows), 3)), np.zeros(len(rows), bool)
            fill_surface(self._kind, self._half, np.ascontiguousarray(self._found.rotations[k]), self._centres[k],
                         pixels, self._focal, FACING, points, normals, seen)  # fmt: skip
            pictures[k, rows, columns] = (
                frame[rows, columns] @ vectors[:, -1] - _quadratic(normals) @ fit - still[_bin(normals)]
            )
        return pictures

    def turns(self, window: list[int], turn: np.ndarray) -> np.ndarray:
        """(L, 3, 3) turns of intervals, by a rotation vector (3,), of a cylinder by an angle (1,) about its axis."""
        if self._kind == CYLINDER:
            return np.array([Rotation.from_rotvec(turn[0] * self._axes[k + 1]).as_matrix() @ self._carried(k)
                             for k in window])  # fmt: skip
        return np.repeat(Rotation.from_rotvec(turn).as_matrix()[None], len(window), 0)

    def _carried(self, k: int) -> np.ndarray:
        """The smallest rotation that takes the axis of a frame to that of the next."""
        a, b = self._axes[k], self._axes[k + 1]
        cross = np.cross(a, b)
        return Rotation.from_rotvec(cross / max(float(np.linalg.norm(cross)), 1e-12)
                                    * np.arctan2(np.linalg.norm(cross), a @ b)).as_matrix()  # fmt: skip

    def rolling_turn(self, k: int) -> np.ndarray:
        """The turn over interval k of a body that rolls on a level ground before the usual camera."""
        moved = self._centres[k + 1] - self._centres[k]
        turn = np.cross(USUAL_UP, moved) / self._half[0]
        return np.array([turn @ self._axes[k + 1]]) if self._kind == CYLINDER else turn

    def _score(self, window: list[int]) -> Callable[[np.ndarray], float] | None:
        """The correlation over a window as a function of the turn per interval; None where too little is seen."""
        longest = max((min(len(self._values[j]), POINTS) for j in window), default=0)
        if longest < LEAST_POINTS:
            return None
        points, normals = np.zeros((len(window), longest, 3)), np.zeros((len(window), longest, 3))
        values, count = np.zeros((len(window), longest)), np.zeros(len(window), np.int64)
        for row, j in enumerate(window):
            n = len(self._values[j])
            take = np.linspace(0, n - 1, min(n, POINTS)).round().astype(int)
            count[row] = len(take)
            points[row, : len(take)], normals[row, : len(take)] = self._points[j][take], self._normals[j][take]
            values[row, : len(take)] = self._values[j][take]
        after = np.array(window) + 1
        rest = (points, normals, values, count, self._centres[after], self._pictures[after], self._inside[after],
                self._focal)  # fmt: skip
        if self._kind == CYLINDER:
            carried = np.array([self._carried(j) for j in window])
            axes = self._axes[after]

        def score(turn: np.ndarray) -> float:
            if self._kind == CYLINDER:
                return correlation(about(axes, turn[0]) @ carried, *rest)
            return correlation(np.repeat(about(turn[None], 1.0), len(window), 0), *rest)

        return score

    def refined_turn(self, window: list[int], turn: np.ndarray) -> tuple[np.ndarray, float]:
        """The turn per interval of the largest correlation near a given one, and that."""
        score = self._score(window)
        return (turn, -1.0) if score is None else _refined(score, turn, score(turn))

    def best_turn(self, window: list[int], k: int, last: np.ndarray | None) -> tuple[np.ndarray, float]:
        """The turn per interval of the largest correlation over a window about interval k, and that.

        last: The turn of the interval before, if it is known.
        """
        unknowns = 1 if self._kind == CYLINDER else 3
        score = self._score(window)
        if score is None:
            return np.zeros(unknowns), -1.0
        rolling = self.rolling_turn(k)
        rolling, rolling_value = _refined(score, rolling, score(rolling))
        if last is not None:
            turn, value = _refined(score, last, score(last))
            if max(value, rolling_value) >= TRUSTED:
                return (rolling, rolling_value) if rolling_value >= ROLLING_SHARE * value else (turn, value)
        grid = np.arange(-FASTEST, FASTEST + 1e-9, COARSE)
        trials = np.stack(np.meshgrid(*[grid] * unknowns, indexing="ij"), -1).reshape(-1, unknowns)
        trials = trials[np.linalg.norm(trials, axis=1) <= FASTEST + 1e-9]
        scores = np.array([score(t) for t in trials])
        starts = np.argsort(-scores)[:4]
        turn, value = max((_refined(score, trials[j], scores[j]) for j in starts), key=lambda found: found[1])
        return (rolling, rolling_value) if rolling_value >= ROLLING_SHARE * value else (turn, value)


def _refined(score: Callable[[np.ndarray], float], turn: np.ndarray, value: float) -> tuple[np.ndarray, float]:
    """A local maximum of the score from a turn, by steps along its axes, and its value."""
    step = 0.5 * COARSE
    while step >= FINE:
        moved = False
        for axis in range(len(turn)):
            for sign in (step, -step):
                trial = turn.copy()
                trial[axis] += sign
                new = score(trial)
                if new > value:
                    turn, value, moved = trial, new, True
        if not moved:
            step *= 0.5
    return turn, value


def _bin(normals: np.ndarray) -> np.ndarray:
    """Index (P,) of the bin of the first two components of normals (P, 3)."""
    x, y = np.clip(((normals[:, :2] + 1) * BINS / 2).astype(int), 0, BINS - 1).T
    return x * BINS + y


def _quadratic(normals: np.ndarray) -> np.ndarray:
    """Terms (P, 6) of a quadratic function of the first two components of normals (P, 3)."""
    x, y = normals[:, 0], normals[:, 1]
    return np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y], 1)
