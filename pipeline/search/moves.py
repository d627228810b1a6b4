"""Leaps to other descriptions of an object that look alike: what a slope does not lead to.

Another turn, a smaller body nearer to the camera, another spin or speed, other sizes. Each object of each candidate is
moved on its own, so that of a batch the best may be taken object by object.
"""

from __future__ import annotations

import numpy as np

from pipeline.physics.batch import SceneBatch
from pipeline.scene.rotation import quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.solid import reaches_below
from pipeline.search.parameters import BOUNDS

SHARE = 0.4  # of the candidates that each kind of move changes
GROUNDED = 0.01  # m above the ground, within which a body stands on it


def moved(rng: np.random.Generator, scene: SceneBatch, count: int, movable: list[int]) -> SceneBatch:
    """So many variations of the first scene of a batch; the first of them is that scene itself. Only the objects
    `movable` (indices) change."""
    out = scene.repeated(count)
    for i in movable:
        _move(rng, out, i)
        out.copy_object(i, scene, 0)
    return out


def _move(rng: np.random.Generator, batch: SceneBatch, i: int) -> None:
    shape, count = batch.shapes[i], len(batch)
    ground = batch.ground[0]
    reach = reaches_below(shape, batch.half_size[:, i], batch.quaternion[:, i])
    stands = batch.position[:, i, 2] - reach - np.nan_to_num(ground, nan=-np.inf) < GROUNDED

    def some() -> np.ndarray:
        return rng.random(count) < SHARE

    if shape != "sphere":
        chosen = some()
        batch.quaternion[chosen, i] = _turned(rng, batch.quaternion[chosen, i])
    chosen = some()
    ray = batch.position[:, i] - batch.camera_position
    factor = np.where(chosen, np.exp(rng.normal(-0.1, 0.25, count)), 1.0)[:, None]
    batch.position[:, i] = batch.camera_position + factor * ray
    batch.half_size[:, i] *= factor
    batch.velocity[:, i] *= factor
    stands &= ~chosen | (rng.random(count) < 0.5)
    chosen = some()[:, None]
    batch.half_size[:, i] = np.where(chosen, _resized(rng, shape, batch.half_size[:, i]), batch.half_size[:, i])
    chosen = some()[:, None]
    push = rng.normal(0, 0.2, (count, 3)) * np.where(stands, [[1.0], [1.0], [0.0]], 1.0).T
    batch.velocity[:, i] = np.where(chosen, batch.velocity[:, i] + push, batch.velocity[:, i])
    chosen = some()[:, None]
    batch.angular_velocity[:, i] = np.where(chosen, _spun(rng, batch, i), batch.angular_velocity[:, i])
    batch.half_size[:, i] = np.clip(batch.half_size[:, i], BOUNDS["size"][0], BOUNDS["size"][1] / 2)
    reach = reaches_below(shape, batch.half_size[:, i], batch.quaternion[:, i])
    if not np.isnan(ground):
        lowest = ground + reach
        batch.position[:, i, 2] = np.where(stands, lowest, np.maximum(batch.position[:, i, 2], lowest))


def _turned(rng: np.random.Generator, quaternion: np.ndarray) -> np.ndarray:
    """Other orientations (B, 4): about the vertical, upright, lying, or anyhow."""
    count = len(quaternion)
    yaw = np.zeros((count, 3))
    yaw[:, 2] = rng.uniform(-np.pi, np.pi, count)
    about = quaternion_from_rotation_vector(yaw)
    lying = quaternion_multiply(about, quaternion_from_rotation_vector(np.array([[np.pi / 2, 0, 0]])))
    anyhow = rng.normal(size=(count, 4))
    anyhow /= np.linalg.norm(anyhow, axis=1, keepdims=True)
    tilted = quaternion_multiply(quaternion_from_rotation_vector(rng.normal(0, 0.4, (count, 3))), quaternion)
    kind = rng.integers(5, size=count)[:, None]
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
        resized[:, 2] = np.maximum(resized[:, 2], 1.05 * resized[:, 0])
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
