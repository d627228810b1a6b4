"""Random candidate scenes. `pipeline.clips.draw` decides which of them are accepted.

The default camera is that of the paper: at (0, -2, h), looking along +y and down.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.canonical import canonical_object, rounded_object, rounded_scene
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import BASIC_SHAPES, Camera, Scene, SceneObject
from pipeline.scene.solid import reach_below

Range = tuple[float, float]


@dataclass(frozen=True)
class Distribution:
    """Ranges (low, high) from which a scene is drawn, uniformly unless noted. Objects not airborne start on the ground.

    Attributes:
        camera_height: m above the ground.
        camera_distance: m from the origin, along -y.
        camera_target_height: Height of the point above the origin at which the camera looks, m.
        camera_fov: Vertical field of view, deg.
        gravity: m/s², downwards.
        sphere_radius: m.
        cylinder_radius: m.
        cylinder_height: m.
        box_side: m, each of the three sides.
        mass: kg, log-uniform.
        sliding_friction: Coefficient.
        rolling_friction: m.
        damping: Damping ratio of contacts.
        x: m, initial position.
        y: m, initial position.
        airborne: Share of objects that start in the air.
        drop_height: Gap between an airborne object and the ground, m.
        speed: Horizontal, m/s.
        toward: Share of velocities that point to another place of the scene instead of any direction.
        rolling: Share of round bodies on the ground that start to roll without slip.
        spin: Angular speed, rad/s.
        lying: Share of cylinders on the ground that lie on their side.
    """

    camera_height: Range
    camera_distance: float
    camera_target_height: Range
    camera_fov: Range
    gravity: Range
    sphere_radius: Range
    cylinder_radius: Range
    cylinder_height: Range
    box_side: Range
    mass: Range
    sliding_friction: Range
    rolling_friction: Range
    damping: Range
    x: Range
    y: Range
    airborne: float
    drop_height: Range
    speed: Range
    toward: float
    rolling: float
    spin: Range
    lying: float


def compositions(count: int) -> list[tuple[str, ...]]:
    """All multisets of `count` basic shapes, as sorted tuples."""
    return [tuple(sorted(c)) for c in itertools.combinations_with_replacement(sorted(BASIC_SHAPES), count)]


def draw_composition(
    rng: np.random.Generator,
    counts: Mapping[int, float],
    only: Sequence[str] = (),
    without: Sequence[str] = (),
) -> tuple[str, ...]:
    """Sorted shapes of a scene: a number of objects is drawn first, then a multiset of so many shapes.

    Args:
        rng: Random generator.
        counts: Weight of each number of objects.
        only: Compositions (`box+box+sphere`) to choose from instead.
        without: Compositions that are never drawn.
    """
    if only:
        return tuple(sorted(only[int(rng.integers(len(only)))].split("+")))
    numbers = sorted(counts)
    weights = np.array([counts[n] for n in numbers], float)
    count = numbers[rng.choice(len(numbers), p=weights / weights.sum())]
    allowed = [c for c in compositions(count) if "+".join(c) not in without]
    return allowed[int(rng.integers(len(allowed)))]


def draw_scene(rng: np.random.Generator, shapes: Sequence[str], d: Distribution) -> Scene:
    """One candidate scene of the given shapes, in the canonical description (`pipeline.scene.canonical`)."""
    height = rng.uniform(*d.camera_height)
    target = rng.uniform(*d.camera_target_height)
    pitch = -np.degrees(np.arctan2(height - target, d.camera_distance))
    camera = Camera((0.0, -d.camera_distance, height), fov=rng.uniform(*d.camera_fov), pitch=pitch)
    objects = tuple(rounded_object(canonical_object(_draw_object(rng, shape, d))) for shape in shapes)
    return rounded_scene(Scene(objects, camera, (0.0, 0.0, -rng.uniform(*d.gravity))))


def _draw_object(rng: np.random.Generator, shape: str, d: Distribution) -> SceneObject:
    size = {
        "sphere": lambda: (rng.uniform(*d.sphere_radius),),
        "cylinder": lambda: (rng.uniform(*d.cylinder_radius), rng.uniform(*d.cylinder_height)),
        "box": lambda: tuple(rng.uniform(*d.box_side, 3)),
    }[shape]()
    airborne = rng.random() < d.airborne
    orientation = _draw_orientation(rng, shape, airborne, d)
    obj = SceneObject(
        shape=shape,
        size=size,
        mass=float(np.exp(rng.uniform(*np.log(d.mass)))),
        sliding_friction=rng.uniform(*d.sliding_friction),
        rolling_friction=rng.uniform(*d.rolling_friction),
        damping=rng.uniform(*d.damping),
        orientation=tuple(orientation),
    )
    obj = rounded_object(canonical_object(obj))
    x, y = rng.uniform(*d.x), rng.uniform(*d.y)
    gap = rng.uniform(*d.drop_height) if airborne else 0.0
    z = np.ceil(1000 * (reach_below(obj) + gap)) / 1000  # rounded up, so that it does not penetrate the ground
    heading = rng.uniform(-np.pi, np.pi)
    if rng.random() < d.toward:
        heading = np.arctan2(rng.uniform(*d.y) - y, rng.uniform(*d.x) - x)
    speed = rng.uniform(*d.speed)
    vertical = rng.normal(0, 0.3) if airborne else 0.0
    velocity = np.array([speed * np.cos(heading), speed * np.sin(heading), vertical])
    spin = _draw_spin(rng, obj, airborne, velocity, d)
    return replace(obj, position=(x, y, z), velocity=tuple(velocity), angular_velocity=tuple(spin))


def _draw_orientation(rng: np.random.Generator, shape: str, airborne: bool, d: Distribution) -> np.ndarray:
    if airborne:
        q = rng.normal(size=4)
        return q / np.linalg.norm(q)
    yaw = rng.uniform(-np.pi, np.pi)
    if shape == "cylinder" and rng.random() < d.lying:  # its axis, z, is horizontal and has the yaw's direction
        return np.array([np.cos(yaw / 2), -np.sin(yaw / 2), np.cos(yaw / 2), np.sin(yaw / 2)]) / np.sqrt(2)
    return np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])


def _draw_spin(
    rng: np.random.Generator, obj: SceneObject, airborne: bool, velocity: np.ndarray, d: Distribution
) -> np.ndarray:
    """Angular velocity (3,), world frame, rad/s: rolling without slip, tumbling in the air, or about the vertical."""
    axis = matrix_from_quaternion(np.array(obj.orientation))[:, 2]
    lying = obj.shape == "cylinder" and abs(axis[2]) < 0.01
    if not airborne and (obj.shape == "sphere" or lying) and rng.random() < d.rolling:
        omega = np.cross([0.0, 0.0, 1.0], velocity) / obj.size[0]
        return omega if obj.shape == "sphere" else axis * (axis @ omega)
    if airborne or obj.shape == "sphere":
        direction = rng.normal(size=3)
        return direction / np.linalg.norm(direction) * rng.uniform(*d.spin)
    return np.array([0.0, 0.0, rng.choice([-1.0, 1.0]) * rng.uniform(*d.spin)])
