"""Random jumps of single objects to descriptions that look alike, which a gradient step does not reach.

A jump gives an object another orientation with sizes that keep its outline, a smaller size nearer to the camera,
another velocity or angular velocity, other sizes, or another material. Each object of each candidate jumps
independently, so the best candidate can be chosen for each object of a batch.
"""

from __future__ import annotations

import numpy as np

from pipeline.physics.batch import SceneBatch
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.solid import reaches_below
from pipeline.search.parameters import BOUNDS

SHARE = 0.4  # of the candidates that each kind of jump changes
#: Probability of each kind where all candidates of an object share one.
KINDS = {"turn": 0.2, "depth": 0.15, "size": 0.05, "push": 0.15, "spin": 0.15, "material": 0.3}
#: Range from which a new value of each material constant is drawn, uniformly in the logarithm.
MATERIALS = {
    "mass": (0.1, 4.0),
    "sliding_friction": (0.05, 1.0),
    "rolling_friction": (1e-4, 0.01),
    "damping": (0.1, 1.0),
}
GROUNDED = 0.01  # m above the ground up to which a body counts as standing on it
LEAST_CAPSULE = 1.05  # smallest half height of a capsule, in radii
EQUAL_SIZES_WEIGHT = 0.05  # of equal sizes relative to the outline, in the least squares of `sizes_for_outline`


def propose_jumps(
    rng: np.random.Generator, scene: SceneBatch, count: int, movable: list[int], same_kind: bool = False
) -> SceneBatch:
    """Random variations of a scene. The first of them is the scene itself.

    Args:
        rng: Random generator.
        scene: Its first scene is varied.
        count: Number of variations.
        movable: Indices of the objects that change.
        same_kind: All variations of an object have one random kind of jump in common. Then the best of them is not just
            the one that changed least.
    """
    out = scene.repeated(count)
    for i in movable:
        kinds = [k for k in KINDS if k != "turn" or scene.shapes[i] != "sphere"]
        odds = np.array([KINDS[k] for k in kinds])
        _jump(rng, out, i, str(rng.choice(kinds, p=odds / odds.sum())) if same_kind else None)
        out.copy_object(i, scene, 0)
    return out


def _jump(rng: np.random.Generator, batch: SceneBatch, i: int, common: str | None) -> None:
    """Vary object i of all scenes in place. common: the kind of jump that all of them make."""
    shape, count = batch.shapes[i], len(batch)
    ground = batch.ground[0]
    half, turn, camera = batch.half_size[:, i], batch.quaternion[:, i], batch.camera_rotation
    stands = batch.position[:, i, 2] - reaches_below(shape, half, turn) - np.nan_to_num(ground, nan=-np.inf) < GROUNDED

    def some(kind: str) -> np.ndarray:
        return np.full(count, True) if kind == common else rng.random(count) < SHARE

    if shape != "sphere":
        chosen = some("turn")
        seen = outline(shape, half, turn, camera)
        turn[chosen] = _random_turns(rng, turn, common == "turn")[chosen]
        half[chosen] = sizes_for_outline(shape, half, turn, camera, seen)[chosen]
    chosen = some("depth")
    ray = batch.position[:, i] - batch.camera_position
    factor = np.where(chosen, np.exp(rng.normal(-0.1, 0.25, count)), 1.0)[:, None]
    batch.position[:, i] = batch.camera_position + factor * ray
    half *= factor
    batch.velocity[:, i] *= factor
    stands &= ~chosen | (rng.random(count) < 0.5)
    chosen = some("size")[:, None]
    half[:] = np.where(chosen, _random_sizes(rng, shape, half), half)
    chosen = some("push")[:, None]
    push = rng.normal(0, 0.2, (count, 3)) * np.where(stands, [[1.0], [1.0], [0.0]], 1.0).T
    batch.velocity[:, i] = np.where(chosen, batch.velocity[:, i] + push, batch.velocity[:, i])
    chosen = some("spin")[:, None]
    batch.angular_velocity[:, i] = np.where(chosen, _random_spins(rng, batch, i), batch.angular_velocity[:, i])
    chosen = some("material")
    for name, (least, most) in MATERIALS.items():
        drawn = np.exp(rng.uniform(np.log(least), np.log(most), count))
        column = getattr(batch, name)[:, i]
        column[:] = np.where(chosen & (rng.random(count) < 0.6), drawn, column)
    half[:] = np.clip(half, BOUNDS["size"][0], BOUNDS["size"][1] / 2)
    if not np.isnan(ground):
        lowest = ground + reaches_below(shape, half, turn)
        batch.position[:, i, 2] = np.where(stands, lowest, np.maximum(batch.position[:, i, 2], lowest))


def projected_axes(shape: str, quaternion: np.ndarray, camera_rotation: np.ndarray) -> np.ndarray:
    """Half width and half height in the picture per unit of each half extent, (B, 2, K).

    The K half extents are radius and half height of a cylinder or capsule, and all three of a box. For ellipsoids this
    is an approximation.
    """
    seen = np.abs(np.swapaxes(camera_rotation[..., :2], -1, -2) @ matrix_from_quaternion(quaternion))
    if shape in ("cylinder", "capsule"):
        along = np.minimum(seen[..., 2:], 1)
        return np.concatenate([np.sqrt(1 - along**2), along], -1)
    return seen


def outline(shape: str, half: np.ndarray, quaternion: np.ndarray, camera_rotation: np.ndarray) -> np.ndarray:
    """Half width and half height of bodies in the picture, (B, 2) m.

    Args:
        shape: Of all bodies.
        half: Half extents (B, 3) m.
        quaternion: Orientations (B, 4).
        camera_rotation: (B, 3, 3), columns right, up, back.
    """
    own = half[:, [0, 2]] if shape in ("cylinder", "capsule") else half
    return (projected_axes(shape, quaternion, camera_rotation) @ own[..., None])[..., 0]


def sizes_for_outline(
    shape: str, half: np.ndarray, quaternion: np.ndarray, camera_rotation: np.ndarray, wanted: np.ndarray
) -> np.ndarray:
    """Half extents (B, 3) m with which bodies have a given outline, by least squares.

    Args:
        shape: Of all bodies.
        half: Present half extents (B, 3) m; the solution is regularised towards their mean.
        quaternion: New orientations (B, 4).
        camera_rotation: (B, 3, 3), columns right, up, back.
        wanted: Half width and half height in the picture (B, 2) m.
    """
    reach = projected_axes(shape, quaternion, camera_rotation)
    mean = half.mean(1, keepdims=True)
    even = np.repeat(mean, reach.shape[-1], 1)
    across = np.swapaxes(reach, 1, 2)
    missing = across @ (wanted[..., None] - reach @ even[..., None])
    own = even + np.linalg.solve(across @ reach + EQUAL_SIZES_WEIGHT * np.eye(reach.shape[-1]), missing)[..., 0]
    own = np.clip(own, mean / 3, 3 * mean)
    if shape == "capsule":
        own[:, 1] = np.maximum(own[:, 1], LEAST_CAPSULE * own[:, 0])
    return own[:, [0, 0, 1]] if reach.shape[-1] == 2 else own


def _random_turns(rng: np.random.Generator, quaternion: np.ndarray, alike: bool) -> np.ndarray:
    """Random orientations (B, 4): yawed, upright, lying, tilted or any. alike: one of these for all."""
    count = len(quaternion)
    yaw = np.zeros((count, 3))
    yaw[:, 2] = rng.uniform(-np.pi, np.pi, count)
    about = quaternion_from_rotation_vector(yaw)
    lying = quaternion_multiply(about, quaternion_from_rotation_vector(np.array([[np.pi / 2, 0, 0]])))
    uniform = rng.normal(size=(count, 4))
    uniform /= np.linalg.norm(uniform, axis=1, keepdims=True)
    tilted = quaternion_multiply(quaternion_from_rotation_vector(rng.normal(0, 0.4, (count, 3))), quaternion)
    kind = (np.full(count, rng.integers(5)) if alike else rng.integers(5, size=count))[:, None]
    return np.select(
        [kind == 0, kind == 1, kind == 2, kind == 3],
        [quaternion_multiply(about, quaternion), about, lying, uniform],
        tilted,
    )


def _random_sizes(rng: np.random.Generator, shape: str, half: np.ndarray) -> np.ndarray:
    """Half extents (B, 3) m with random proportions that the shape allows."""
    factor = np.exp(rng.normal(0, 0.2, half.shape))
    if shape == "sphere":
        factor[:, 1:] = factor[:, :1]
    elif shape in ("cylinder", "capsule"):
        factor[:, 1] = factor[:, 0]
    resized = half * factor
    if shape == "capsule":
        resized[:, 2] = np.maximum(resized[:, 2], LEAST_CAPSULE * resized[:, 0])
    return resized


def _random_spins(rng: np.random.Generator, batch: SceneBatch, i: int) -> np.ndarray:
    """Random angular velocities (B, 3) rad/s: none, rolling without slip, about the vertical, or any."""
    count = len(batch)
    rolling = np.cross([0.0, 0.0, 1.0], batch.velocity[:, i]) / batch.half_size[:, i, :1]
    kind = rng.integers(4, size=count)[:, None]
    about = np.zeros((count, 3))
    about[:, 2] = rng.normal(0, 4, count)
    return np.select(
        [kind == 0, kind == 1, kind == 2], [np.zeros((count, 3)), rolling, about], rng.normal(0, 4, (count, 3))
    )
