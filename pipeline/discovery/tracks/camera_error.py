"""How measured positions depend on what is not known of the camera that measured them, to second order.

It is a function of the true position, not of the measured one: else a smaller scale would shrink the noise, and with it
the residuals of every model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

POWERS = tuple((i, j) for i in range(4) for j in range(4 - i))
"""Of the two coordinates in the plane of motion, in the M monomials."""


@dataclass(frozen=True)
class CameraError:
    """What K independent numbers of the camera, in units of their standard deviations, change in measured positions.

    Attributes:
        axes: The two coordinates of the plane in which bodies move.
        centre: (2,) m, about which monomials are taken.
        size: m, in which they are taken.
        slope: (..., M, 3, K) m, coefficients of the first derivatives.
        bend: (..., M, 3, K, K) m, coefficients of the second derivatives.
    """

    axes: tuple[int, int]
    centre: np.ndarray
    size: float
    slope: np.ndarray
    bend: np.ndarray

    @property
    def count(self) -> int:
        """K."""
        return int(self.slope.shape[-1])

    def shift(self, position: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """By how much the numbers (P, K) move what is measured of positions (P, A, n, 3) m, (P, A, n, 3) m."""
        coefficients = np.einsum("amck,pk->pamc", self.slope, numbers)
        coefficients = coefficients + 0.5 * np.einsum("amckl,pk,pl->pamc", self.bend, numbers, numbers, optimize=True)
        out: np.ndarray = self._monomials(position) @ coefficients
        return out

    def derivative(self, position: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        """(A, n, 3, K) m, derivatives of the shift of positions (A, n, 3) at the numbers (K,)."""
        return np.einsum("anm,amck->anck", self._monomials(position), self.slope + self.bend @ numbers, optimize=True)

    def _monomials(self, position: np.ndarray) -> np.ndarray:
        u, v = (np.clip((position[..., a] - c) / self.size, -2, 2) for a, c in zip(self.axes, self.centre, strict=True))
        return np.stack([u**i * v**j for i, j in POWERS], -1)


def camera_error(
    shift: Callable[[np.ndarray, np.ndarray], np.ndarray],
    points: np.ndarray,
    frame: np.ndarray,
    axes: tuple[int, int],
    count: int,
) -> CameraError:
    """The error of a camera as polynomials.

    Args:
        shift: (points (N, 3) m, numbers (K,)) -> (N, 3) m, by how much the numbers move what is measured of the points.
        points: (N, 3) m, all over the plane in which bodies move.
        frame: (F, 2) m, points in the plane, the same for all bodies of a camera, which the monomials are scaled by.
        axes: Its two coordinates.
        count: K.
    """
    step = 0.5  # standard deviations
    unit = step * np.eye(count)
    slope = np.stack([(shift(points, s) - shift(points, -s)) / (2 * step) for s in unit], -1)  # (N, 3, K)
    bend = np.stack(
        [
            np.stack(
                [
                    shift(points, a + b) - shift(points, a - b) - shift(points, b - a) + shift(points, -a - b)
                    for b in unit
                ],
                -1,
            )
            for a in unit
        ],
        -1,
    ) / (4 * step**2)  # (N, 3, K, K)
    size = max(float(np.ptp(frame, axis=0).max()) / 2, 1e-3)
    empty = CameraError(axes, frame.mean(0), size, slope[None], bend[None])
    inverse = np.linalg.pinv(empty._monomials(points))  # (M, N)
    return replace(empty, slope=np.tensordot(inverse, slope, axes=1), bend=np.tensordot(inverse, bend, axes=1))


def stacked(errors: Sequence[CameraError | None]) -> CameraError | None:
    """The errors of several arcs of one camera, with A as the first axis; None where there are none."""
    found = [e for e in errors if e is not None]
    if not found:
        return None
    assert len(found) == len(errors), "all tracks have one camera"
    return replace(found[0], slope=np.stack([e.slope for e in found]), bend=np.stack([e.bend for e in found]))
