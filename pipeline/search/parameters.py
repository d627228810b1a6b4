"""The search space: scenes as vectors whose coordinates all have the range 0 to 1.

Shapes and the number of objects are fixed. A mass is represented by its logarithm; an orientation by a rotation vector
relative to the start, without the rotations that a symmetry of the shape hides. The distance and heading of the camera
are not parameters, because moving the whole world with the camera changes no picture. If the camera of the start has a
pitch, gravity is normal to the ground and the camera is upright, as in the paper. If it has an orientation, the ground
may be inclined: the camera may roll, and gravity may have any downward direction.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.physics.batch import SceneBatch, stack_scenes, unstack
from pipeline.scene.mjcf import camera_quaternion
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import SIZE_KEYS, Camera, Scene, half_from_size
from pipeline.scene.solid import reaches_below

#: Range (low, high) of each parameter, which is mapped to 0 to 1.
BOUNDS: dict[str, tuple[float, float]] = {
    "camera_height": (0.2, 2.5),
    "camera_pitch": (-70.0, 5.0),
    "camera_turn": (-0.8, 0.8),
    "fov": (15.0, 75.0),
    "gravity": (0.5, 20.0),
    "gravity_along": (-10.0, 10.0),
    "size": (0.02, 0.8),
    "log_mass": (float(np.log(0.02)), float(np.log(20.0))),
    "sliding_friction": (0.0, 1.5),
    "rolling_friction": (0.0, 0.05),
    "damping": (0.05, 1.5),
    "x": (-2.0, 2.0),
    "y": (-1.5, 4.0),
    "z": (0.0, 2.0),
    "velocity": (-4.0, 4.0),
    "angular_velocity": (-30.0, 30.0),
    "turn": (-2.0, 2.0),
}
#: Step of finite differences: it moves an outline by about a pixel of 120x80.
STEPS: dict[str, float] = {
    "camera_height": 0.04,
    "camera_pitch": 1.0,
    "camera_turn": 0.017,
    "fov": 1.0,
    "gravity": 0.6,
    "gravity_along": 0.4,
    "size": 0.02,
    "log_mass": 0.4,
    "sliding_friction": 0.08,
    "rolling_friction": 0.004,
    "damping": 0.1,
    "x": 0.02,
    "y": 0.04,
    "z": 0.02,
    "velocity": 0.08,
    "angular_velocity": 1.0,
    "turn": 0.12,
}
MATERIAL_KEYS = ("log_mass", "sliding_friction", "rolling_friction", "damping")
TURNS = {"sphere": 0, "cylinder": 2, "capsule": 2, "box": 3, "ellipsoid": 3}
assert BOUNDS.keys() == STEPS.keys()


@dataclass(frozen=True)
class Key:
    """One coordinate of the search space.

    Attributes:
        bound: Its key in `BOUNDS`.
        index: Its object; -1 for the scene.
        name: The attribute.
        part: Component of the attribute.
    """

    bound: str
    index: int
    name: str
    part: int = 0


@dataclass(frozen=True)
class Space:
    """The search space about a start scene. x: (B, D) in [0, 1]."""

    start: Scene
    keys: tuple[Key, ...]

    @cached_property
    def low(self) -> np.ndarray:
        return np.array([BOUNDS[k.bound][0] for k in self.keys])

    @cached_property
    def span(self) -> np.ndarray:
        return np.array([BOUNDS[k.bound][1] - BOUNDS[k.bound][0] for k in self.keys])

    @cached_property
    def step(self) -> np.ndarray:
        """Steps of finite differences (D,), in units of the range."""
        return np.array([STEPS[k.bound] for k in self.keys]) / self.span

    @cached_property
    def owner(self) -> np.ndarray:
        """Object of each coordinate (D,); -1 for the scene."""
        return np.array([k.index for k in self.keys])

    @cached_property
    def _start(self) -> SceneBatch:
        return stack_scenes([self.start])

    def encode(self) -> np.ndarray:
        """The start as a vector (D,), clipped to the bounds."""
        return np.clip((np.array([self.value(k) for k in self.keys]) - self.low) / self.span, 0, 1)

    def value(self, key: Key) -> float:
        """The value of a coordinate in the start, in its unit."""
        camera = self.start.camera
        assert camera is not None
        if key.index < 0:
            scene = {
                "camera_height": camera.position[2],
                "camera_pitch": camera.pitch,
                "camera_turn": 0.0,
                "fov": camera.fov,
                "gravity": -self.start.gravity[2],
                "gravity_along": self.start.gravity[key.part],
            }
            value = scene[key.name]
            assert value is not None
            return value
        obj = self.start.objects[key.index]
        if key.name == "turn":
            return 0.0
        if key.name == "log_mass":
            return float(np.log(obj.mass))
        value = getattr(obj, key.name)
        return float(value[key.part] if isinstance(value, tuple) else value)

    def decode(self, x: np.ndarray) -> SceneBatch:
        """The scenes of vectors (B, D). Objects that would penetrate the ground are raised onto it."""
        values = np.clip(x, 0, 1) * self.span + self.low
        count, shapes = len(values), self.start.shapes
        batch = self._start.repeated(count)
        sizes: dict[int, list[np.ndarray]] = defaultdict(list)
        turns, camera_turn = np.zeros((count, len(shapes), 3)), np.zeros((count, 3))
        for column, key in zip(values.T, self.keys, strict=True):
            if key.name == "camera_turn":
                camera_turn[:, key.part] = column
            elif key.index < 0:
                _set_scene(batch, key, column)
            elif key.name == "size":
                sizes[key.index].append(column)
            elif key.name == "log_mass":
                batch.mass[:, key.index] = np.exp(column)
            elif key.name == "turn":
                turns[:, key.index, key.part] = column
            elif key.name in ("position", "velocity", "angular_velocity"):
                getattr(batch, key.name)[:, key.index, key.part] = column
            else:
                getattr(batch, key.name)[:, key.index] = column
        for i, columns in sizes.items():
            batch.half_size[:, i] = half_from_size(shapes[i], np.stack(columns, 1))
        batch.camera_rotation[:] @= matrix_from_quaternion(quaternion_from_rotation_vector(camera_turn))
        turned = quaternion_multiply(quaternion_from_rotation_vector(turns), batch.quaternion)
        batch.quaternion[:] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
        if self.start.ground is not None:
            for i, shape in enumerate(shapes):
                reach = reaches_below(shape, batch.half_size[:, i], batch.quaternion[:, i])
                batch.position[:, i, 2] = np.maximum(batch.position[:, i, 2], self.start.ground + reach)
        return batch

    def scene(self, x: np.ndarray) -> Scene:
        """The scene of one vector (D,)."""
        return unstack(self.decode(x[None]), 0, self.start)

    def fixing_camera(self) -> Space:
        """The search space with camera and gravity fixed to those of the start."""
        return Space(self.start, tuple(k for k in self.keys if k.index >= 0))


def _set_scene(batch: SceneBatch, key: Key, values: np.ndarray) -> None:
    """Write values (B,) of a coordinate of the scene into the batch."""
    name = key.name
    if name == "camera_height":
        batch.camera_position[:, 2] = values
    elif name == "camera_pitch":
        pitch = np.radians(values)
        batch.camera_rotation[:, 1, 1], batch.camera_rotation[:, 2, 2] = -np.sin(pitch), -np.sin(pitch)
        batch.camera_rotation[:, 2, 1], batch.camera_rotation[:, 1, 2] = np.cos(pitch), -np.cos(pitch)
    elif name == "fov":
        batch.fov[:] = values
    elif name == "gravity_along":
        batch.gravity[:, key.part] = values
    else:
        batch.gravity[:, 2] = -values


def rollable(camera: Camera) -> Camera:
    """The camera with an orientation instead of its pitch, so that a search may roll it."""
    return replace(camera, pitch=None, orientation=tuple(camera_quaternion(camera)))


def object_keys(shape: str, index: int) -> list[Key]:
    """The coordinates of one object: size, material, position, velocities and orientation."""
    return [
        *(Key("size", index, "size", part) for part in range(len(SIZE_KEYS[shape]))),
        *(Key(k, index, k) for k in MATERIAL_KEYS),
        *(Key(axis, index, "position", part) for part, axis in enumerate("xyz")),
        *(Key(k, index, k, part) for k in ("velocity", "angular_velocity") for part in range(3)),
        *(Key("turn", index, "turn", part) for part in range(TURNS[shape])),
    ]


def search_space(start: Scene) -> Space:
    """The search space around a scene: camera, gravity, and the parameters of each object."""
    assert start.camera is not None
    keys = [Key(k, -1, k) for k in ("camera_height", "fov", "gravity")]
    if start.camera.pitch is not None:
        keys.append(Key("camera_pitch", -1, "camera_pitch"))
    else:  # about the camera's right and back axes; a rotation about its up axis is nearly a change of heading
        keys += [Key("camera_turn", -1, "camera_turn", part) for part in (0, 2)]
        keys += [Key("gravity_along", -1, "gravity_along", part) for part in (0, 1)]
    for i, shape in enumerate(start.shapes):
        keys += object_keys(shape, i)
    return Space(start, tuple(keys))
