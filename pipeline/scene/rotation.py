"""Rotations as unit quaternions (w, x, y, z) and as matrices, for arrays of any leading shape.

A quaternion rotates vectors from the body frame to the world frame, as MuJoCo's `xquat` does.
"""

from __future__ import annotations

import numpy as np

from pipeline.compiled import kernel


@kernel
def fill_matrix(q: np.ndarray, out: np.ndarray) -> None:
    """Write the rotation matrix of one non-zero quaternion q (4,) into out (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    out[0, 0] = 1.0 - s * (y * y + z * z)
    out[0, 1] = s * (x * y - w * z)
    out[0, 2] = s * (x * z + w * y)
    out[1, 0] = s * (x * y + w * z)
    out[1, 1] = 1.0 - s * (x * x + z * z)
    out[1, 2] = s * (y * z - w * x)
    out[2, 0] = s * (x * z - w * y)
    out[2, 1] = s * (y * z + w * x)
    out[2, 2] = 1.0 - s * (x * x + y * y)


@kernel
def _fill_matrices(q: np.ndarray, out: np.ndarray) -> None:
    for i in range(q.shape[0]):
        fill_matrix(q[i], out[i])


def matrix_from_quaternion(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of non-zero quaternions (..., 4)."""
    q = np.asarray(q, dtype=np.float64)
    out = np.empty((*q.shape[:-1], 3, 3))
    _fill_matrices(np.ascontiguousarray(q).reshape(-1, 4), out.reshape(-1, 3, 3))
    return out


def quaternion_multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product a b (..., 4): the rotation b followed by the rotation a."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    aw, bw = a[..., :1], b[..., :1]
    av, bv = a[..., 1:], b[..., 1:]
    scalar = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    return np.concatenate([scalar, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def quaternion_conjugate(q: np.ndarray) -> np.ndarray:
    """The inverse of unit quaternions (..., 4)."""
    return np.asarray(q, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(q: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) rotated by quaternions (..., 4); leading shapes broadcast."""
    return np.einsum("...ij,...j->...i", matrix_from_quaternion(q), np.asarray(vectors, dtype=np.float64))


def quaternion_from_rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of rotation vectors (..., 3), whose length is the angle in rad."""
    rotation = np.asarray(rotation, dtype=np.float64)
    half = 0.5 * np.linalg.norm(rotation, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotation], axis=-1)


def integrate(q: np.ndarray, angular_velocity_world: np.ndarray, seconds: float) -> np.ndarray:
    """Quaternions (..., 4) after `seconds` at a constant angular velocity (..., 3), rad/s, in the world frame."""
    return quaternion_multiply(quaternion_from_rotation_vector(np.asarray(angular_velocity_world) * seconds), q)
