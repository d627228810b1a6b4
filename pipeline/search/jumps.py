"""Leaps to other descriptions of an object that look alike: what a slope does not lead to.

Another turn with sizes that leave the outline as it is, a smaller body nearer to the camera, another spin or speed,
other sizes. Each object of each candidate is moved on its own, so that of a batch the best may be taken object by
object.
"""

from __future__ import annotations

import numpy as np

from pipeline.physics.batch import SceneBatch
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.solid import reaches_below
from pipeline.search.parameters import BOUNDS

SHARE = 0.4  # of the candidates that each kind of move changes
LEAPS = {"turn": 0.4, "depth": 0.2, "size": 0.1, "push": 0.1, "spin": 0.2}  # how often each makes a leap
GROUNDED = 0.01  # m above the ground, within which a body stands on it
CAPSULE = 1.05  # least half height of a capsule, in radii
EVEN = 0.05  # weight of even sizes, beside that of the outline, where a body is turned


def moved(
    rng: np.random.Generator, scene: SceneBatch, count: int, movable: list[int], leap: bool = False
) -> SceneBatch:
    """So many variations of the first scene of a batch; the first of them is that scene itself. Only the objects
    `movable` (indices) change. leap: those of an object have a kind of change in common, so that the best of them is
    not just the one that changed least."""
    out = scene.repeated(count)
    for i in movable:
        kinds = [k for k in LEAPS if k != "turn" or scene.shapes[i] != "sphere"]
        odds = np.array([LEAPS[k] for k in kinds])
        _move(rng, out, i, str(rng.choice(kinds, p=odds / odds.sum())) if leap else None)
        out.copy_object(i, scene, 0)
    return out


def _move(rng: np.random.Generator, batch: SceneBatch, i: int, common: str | None) -> None:
    shape, count = batch.shapes[i], len(batch)
    ground = batch.ground[0]
    half, turn, camera = batch.half_size[:, i], batch.quaternion[:, i], batch.camera_rotation
    stands = batch.position[:, i, 2] - reaches_below(shape, half, turn) - np.nan_to_num(ground, nan=-np.inf) < GROUNDED

    def some(kind: str) -> np.ndarray:
        return np.full(count, True) if kind == common else rng.random(count) < SHARE

    if shape != "sphere":
        chosen = some("turn")
        seen = outline(shape, half, turn, camera)
        turn[chosen] = _turned(rng, turn, common == "turn")[chosen]
        half[chosen] = with_outline(shape, half, turn, camera, seen)[chosen]
    chosen = some("depth")
    ray = batch.position[:, i] - batch.camera_position
    factor = np.where(chosen, np.exp(rng.normal(-0.1, 0.25, count)), 1.0)[:, None]
    batch.position[:, i] = batch.camera_position + factor * ray
    half *= factor
    batch.velocity[:, i] *= factor
    stands &= ~chosen | (rng.random(count) < 0.5)
    chosen = some("size")[:, None]
    half[:] = np.where(chosen, _resized(rng, shape, half), half)
    chosen = some("push")[:, None]
    push = rng.normal(0, 0.2, (count, 3)) * np.where(stands, [[1.0], [1.0], [0.0]], 1.0).T
    batch.velocity[:, i] = np.where(chosen, batch.velocity[:, i] + push, batch.velocity[:, i])
    chosen = some("spin")[:, None]
    batch.angular_velocity[:, i] = np.where(chosen, _spun(rng, batch, i), batch.angular_velocity[:, i])
    half[:] = np.clip(half, BOUNDS["size"][0], BOUNDS["size"][1] / 2)
    if not np.isnan(ground):
        lowest = ground + reaches_below(shape, half, turn)
        batch.position[:, i, 2] = np.where(stands, lowest, np.maximum(batch.position[:, i, 2], lowest))


def reaches(shape: str, quaternion: np.ndarray, camera_rotation: np.ndarray) -> np.ndarray:
    """(B, 2, K): how far bodies reach to the right and up in the picture for each of their K own half extents: radius
    and half height of what is round, the three of a box (and nearly so of an ellipsoid)."""
    seen = np.abs(np.swapaxes(camera_rotation[..., :2], -1, -2) @ matrix_from_quaternion(quaternion))
    if shape in ("cylinder", "capsule"):
        along = np.minimum(seen[..., 2:], 1)
        return np.concatenate([np.sqrt(1 - along**2), along], -1)
    return seen


def outline(shape: str, half: np.ndarray, quaternion: np.ndarray, camera_rotation: np.ndarray) -> np.ndarray:
    """(B, 2) m: half width and half height of bodies in the picture, by half extents (B, 3) and orientation."""
    own = half[:, [0, 2]] if shape in ("cylinder", "capsule") else half
    return (reaches(shape, quaternion, camera_rotation) @ own[..., None])[..., 0]


def with_outline(
    shape: str, half: np.ndarray, quaternion: np.ndarray, camera_rotation: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Half extents (B, 3) with which bodies that were turned look as wide and as high as `wanted` (B, 2) m, as near to
    even ones as that allows: least squares."""
    reach = reaches(shape, quaternion, camera_rotation)
    mean = half.mean(1, keepdims=True)
    even = np.repeat(mean, reach.shape[-1], 1)
    across = np.swapaxes(reach, 1, 2)
    missing = across @ (wanted[..., None] - reach @ even[..., None])
    own = even + np.linalg.solve(across @ reach + EVEN * np.eye(reach.shape[-1]), missing)[..., 0]
    own = np.clip(own, mean / 3, 3 * mean)
    if shape == "capsule":
        own[:, 1] = np.maximum(own[:, 1], CAPSULE * own[:, 0])
    return own[:, [0, 0, 1]] if reach.shape[-1] == 2 else own


def _turned(rng: np.random.Generator, quaternion: np.ndarray, alike: bool) -> np.ndarray:
    """Other orientations (B, 4): about the vertical, upright, lying, tilted, or anyhow; alike: all in one such way."""
    count = len(quaternion)
    yaw = np.zeros((count, 3))
    yaw[:, 2] = rng.uniform(-np.pi, np.pi, count)
    about = quaternion_from_rotation_vector(yaw)
    lying = quaternion_multiply(about, quaternion_from_rotation_vector(np.array([[np.pi / 2, 0, 0]])))
    anyhow = rng.normal(size=(count, 4))
    anyhow /= np.linalg.norm(anyhow, axis=1, keepdims=True)
    tilted = quaternion_multiply(quaternion_from_rotation_vector(rng.normal(0, 0.4, (count, 3))), quaternion)
    kind = (np.full(count, rng.integers(5)) if alike else rng.integers(5, size=count))[:, None]
    return np.select([kind == 0, kind == 1, kind == 2, kind == 3],
                     [quaternion_multiply(about, quaternion), about, lying, anyhow], tilted)  # fmt: skip


def _resized(rng: np.random.Generator, shape: str, half: np.ndarray) -> np.ndarray:
    """Half extents (B, 3) of other proportions, as the shape allows."""
    factor = np.exp(rng.normal(0, 0.2, half.shape))
    if shape == "sphere":
        factor[:, 1:] = factor[:, :1]
    elif shape in ("cylinder", "capsule"):
        factor[:, 1] = factor[:, 0]
    resized = half * factor
    if shape == "capsule":
        resized[:, 2] = np.maximum(resized[:, 2], CAPSULE * resized[:, 0])
    return resized


def _spun(rng: np.random.Generator, batch: SceneBatch, i: int) -> np.ndarray:
    """Angular velocities (B, 3): none, rolling without slip, or any."""
    count = len(batch)
    rolling = np.cross([0.0, 0.0, 1.0], batch.velocity[:, i]) / batch.half_size[:, i, :1]
    kind = rng.integers(4, size=count)[:, None]
    about = np.zeros((count, 3))
    about[:, 2] = rng.normal(0, 4, count)
    return np.select([kind == 0, kind == 1, kind == 2], [np.zeros((count, 3)), rolling, about],
                     rng.normal(0, 4, (count, 3)))  # fmt: skip
