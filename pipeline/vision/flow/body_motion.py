"""Motion of a body's pixels between two frames, from all of its texture at once.

Where a body is plain, and where it turns, an estimator's flow of single pixels is wrong or a guess. A rigid body's flow
has few numbers: here it is a quadratic function of the pixel, which is exact to second order for planes and balls. Its
coefficients p minimise, over the body's pixels x with the estimator's flow f (Lucas and Kanade, IJCAI 1981, with a
prior),

    sum log(1 + |b(x + A(x) p) - a(x) - c|^2 / SIGMA^2) + PRIOR sum w(x) |A(x) p - f(x)|^2,

so the pictures decide what they show, and the estimator decides the rest. c: change of the body's mean colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.compiled import kernel

TERMS = 6  # of the quadratic function: 1, x, y, x^2, xy, y^2
LEAST_PX = 12  # a smaller body keeps the estimator's flow
SIGMA = 5.0  # of 255: a larger difference between the two pictures counts less and less
PRIOR = 0.02
EDGE_WEIGHT = 0.1  # of the estimator's flow within a pixel of the body's edge, where it is mixed with the background's
LEAST_WEIGHT = 0.02  # of the estimator's flow where nothing supports it
RIDGE = 1e-3  # share of the prior's weight that pulls all terms but the constant to zero
SHADING = 4.0  # px, sigma of what is taken off: shading stays where a body turns under it
SMOOTHINGS = (1.5, 0.0)  # px, sigma of the pictures' blur, coarse to fine
STEPS = 8  # at each
CONVERGED = 0.01  # px


@dataclass(frozen=True)
class BodyMotion:
    """A quadratic function of the pixel: coefficients (TERMS, 2) px, of lengths from centre (x, y) in units of size."""

    centre: tuple[float, float]
    size: float
    coefficients: np.ndarray

    def at(self, cols: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Flow (N, 2) px at pixels (N,)."""
        return np.asarray(_terms(cols, rows, self.centre, self.size) @ self.coefficients)


def body_motions(
    frame_a: np.ndarray, frame_b: np.ndarray, flow: np.ndarray, mask: np.ndarray, weight: np.ndarray
) -> dict[int, BodyMotion]:
    """The motion of each body between two frames, of those with LEAST_PX pixels or more.

    Args:
        frame_a: (H, W, 3) uint8 RGB.
        frame_b: (H, W, 3) uint8, the frame to which the flow leads.
        flow: (H, W, 2) px, the estimator's.
        mask: (H, W) uint8 ids of bodies in frame a, 0 for the background.
        weight: (H, W) in 0 to 1, how far the estimator's flow can be relied on.
    """
    a, b = (_unshaded(frame) for frame in (frame_a, frame_b))
    levels = [(_blurred(a, sigma), *_with_slopes(_blurred(b, sigma))) for sigma in SMOOTHINGS]
    inner = cv2.erode(_ids_alone(mask), np.ones((3, 3), np.uint8)) > 0
    trust = PRIOR * np.where(inner, 1.0, EDGE_WEIGHT) * np.maximum(weight, LEAST_WEIGHT)
    found = {}
    for body in np.unique(mask[mask > 0]):
        rows, cols = np.nonzero(mask == body)
        if len(rows) < LEAST_PX:
            continue
        centre, size = (float(cols.mean()), float(rows.mean())), float(np.sqrt(len(rows)))
        terms = _terms(cols, rows, centre, size)
        given, own = flow[rows, cols].astype(np.float64), trust[rows, cols]
        p = _prior_fit(terms, given, own)
        for first, second, across, down in levels:
            _refine(terms, rows, cols, given, own, first[rows, cols], second, across, down, p)
        found[int(body)] = BodyMotion(centre, size, p)
    return found


def _terms(cols: np.ndarray, rows: np.ndarray, centre: tuple[float, float], size: float) -> np.ndarray:
    """The terms (N, TERMS) of the quadratic function at pixels."""
    x, y = (cols - centre[0]) / size, (rows - centre[1]) / size
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)


def _ids_alone(mask: np.ndarray) -> np.ndarray:
    """The mask with 0 where two bodies meet, so that eroding it shrinks each."""
    low = cv2.erode(mask, np.ones((3, 3), np.uint8))
    high = cv2.dilate(mask, np.ones((3, 3), np.uint8))
    return np.where(low == high, mask, 0).astype(np.uint8)


def _unshaded(frame: np.ndarray) -> np.ndarray:
    picture = frame.astype(np.float32)
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), SHADING))


def _blurred(picture: np.ndarray, sigma: float) -> np.ndarray:
    return picture if sigma == 0 else cv2.GaussianBlur(picture, (0, 0), sigma)


def _with_slopes(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture and its derivatives, a px."""
    across, down = (cv2.Scharr(picture, cv2.CV_32F, *order) / 32 for order in ((1, 0), (0, 1)))
    return picture, across, down


def _prior_fit(basis: np.ndarray, given: np.ndarray, trust: np.ndarray) -> np.ndarray:
    """The coefficients (TERMS, 2) nearest to the given flow (N, 2)."""
    normal = basis.T @ (basis * trust[:, None]) + _ridge(trust)
    return np.asarray(np.linalg.solve(normal, basis.T @ (given * trust[:, None])))


@kernel
def _ridge(trust: np.ndarray) -> np.ndarray:
    out = np.zeros((TERMS, TERMS))
    for k in range(1, TERMS):
        out[k, k] = RIDGE * trust.sum()
    return out


@kernel
def _refine(
    basis: np.ndarray,
    rows: np.ndarray,
    cols: np.ndarray,
    given: np.ndarray,
    trust: np.ndarray,
    colours: np.ndarray,
    b: np.ndarray,
    across: np.ndarray,
    down: np.ndarray,
    p: np.ndarray,
) -> None:
    """Gauss-Newton on p (TERMS, 2), in place, by iteratively reweighted least squares.

    Args:
        basis: (N, TERMS), of the body's pixels.
        rows, cols: (N,), of these pixels in frame a.
        given: (N, 2) px, the estimator's flow.
        trust: (N,), weights of the prior.
        colours: (N, 3), frame a there.
        b, across, down: (H, W, 3), frame b and its slopes.
        p: (TERMS, 2).
    """
    count = len(rows)
    height, width = b.shape[:2]
    change = np.zeros((count, 3))
    slopes = np.zeros((count, 2, 3))
    size = 2 * TERMS
    ridge = _ridge(trust)
    for _ in range(STEPS):
        for i in range(count):
            u, v = 0.0, 0.0
            for k in range(TERMS):
                u += basis[i, k] * p[k, 0]
                v += basis[i, k] * p[k, 1]
            x = min(max(cols[i] + u, 0.0), width - 1.001)
            y = min(max(rows[i] + v, 0.0), height - 1.001)
            left, top = int(x), int(y)
            s, t = x - left, y - top
            for c in range(3):
                change[i, c] = -colours[i, c]
                slopes[i, 0, c] = 0.0
                slopes[i, 1, c] = 0.0
            for dy in range(2):
                for dx in range(2):
                    share = (s if dx else 1 - s) * (t if dy else 1 - t)
                    for c in range(3):
                        change[i, c] += share * b[top + dy, left + dx, c]
                        slopes[i, 0, c] += share * across[top + dy, left + dx, c]
                        slopes[i, 1, c] += share * down[top + dy, left + dx, c]
        for c in range(3):
            change[:, c] -= np.median(change[:, c])
        normal = np.zeros((size, size))
        right = np.zeros(size)
        for i in range(count):
            square = (change[i, 0] ** 2 + change[i, 1] ** 2 + change[i, 2] ** 2) / 3
            weight = 1 / (SIGMA**2 + square)
            xx, xy, yy, rx, ry = trust[i], 0.0, trust[i], 0.0, 0.0
            u, v = given[i, 0], given[i, 1]
            for k in range(TERMS):
                u -= basis[i, k] * p[k, 0]
                v -= basis[i, k] * p[k, 1]
            rx, ry = trust[i] * u, trust[i] * v
            for c in range(3):
                gx, gy = slopes[i, 0, c], slopes[i, 1, c]
                xx += weight * gx * gx
                xy += weight * gx * gy
                yy += weight * gy * gy
                rx -= weight * gx * change[i, c]
                ry -= weight * gy * change[i, c]
            for k in range(TERMS):
                right[k] += basis[i, k] * rx
                right[TERMS + k] += basis[i, k] * ry
                for m in range(TERMS):
                    product = basis[i, k] * basis[i, m]
                    normal[k, m] += product * xx
                    normal[k, TERMS + m] += product * xy
                    normal[TERMS + k, m] += product * xy
                    normal[TERMS + k, TERMS + m] += product * yy
        for k in range(TERMS):
            normal[k, k] += ridge[k, k]
            normal[TERMS + k, TERMS + k] += ridge[k, k]
            right[k] -= ridge[k, k] * p[k, 0]
            right[TERMS + k] -= ridge[k, k] * p[k, 1]
        step = np.linalg.solve(normal, right)
        largest = 0.0
        for k in range(TERMS):
            p[k, 0] += step[k]
            p[k, 1] += step[TERMS + k]
            largest = max(largest, abs(step[k]), abs(step[TERMS + k]))
        if largest < CONVERGED:
            break
