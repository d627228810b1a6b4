"""Scenes as vectors: what a search may move, scaled so that every coordinate has a like range.

Types and their number are fixed. Masses are searched in their logarithm; an orientation as a rotation vector from the
start's, without the turns that a shape's symmetry hides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.scene.rotation import quaternion_multiply
from pipeline.scene.scene import SIZE_KEYS, Scene, SceneObject
from pipeline.scene.solid import reach_below

#: Low, high of every parameter; a step of 1 in the search is this whole range.
BOUNDS: dict[str, tuple[float, float]] = {
    "camera_height": (0.2, 2.5),
    "camera_pitch": (-70.0, 5.0),
    "fov": (15.0, 75.0),
    "gravity": (0.5, 20.0),
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
TURNS = {"sphere": 0, "cylinder": 2, "capsule": 2, "box": 3, "ellipsoid": 3}


@dataclass(frozen=True)
class Space:
    """The search space about a start scene with a pitch camera and downward gravity. x: (B, D) in [0, 1]."""

    start: Scene
    keys: tuple[tuple[str, int, str, int], ...]  # bound, object (-1: the scene), attribute, component

    @property
    def low(self) -> np.ndarray:
        return np.array([BOUNDS[k[0]][0] for k in self.keys])

    @property
    def span(self) -> np.ndarray:
        return np.array([BOUNDS[k[0]][1] - BOUNDS[k[0]][0] for k in self.keys])

    def encode(self) -> np.ndarray:
        """(D,) the start, inside the bounds."""
        values = [self._value(bound, index, name, part) for bound, index, name, part in self.keys]
        return np.clip((np.array(values) - self.low) / self.span, 0, 1)

    def _value(self, bound: str, index: int, name: str, part: int) -> float:
        camera = self.start.camera
        assert camera is not None
        assert camera.pitch is not None
        if index < 0:
            scene = {"camera_height": camera.position[2], "camera_pitch": camera.pitch, "fov": camera.fov,
                     "gravity": -self.start.gravity[2]}  # fmt: skip
            return scene[name]
        obj = self.start.objects[index]
        if name == "turn":
            return 0.0
        if name == "log_mass":
            return float(np.log(obj.mass))
        value = getattr(obj, name)
        return float(value[part] if isinstance(value, tuple) else value)

    def decode(self, x: np.ndarray) -> list[Scene]:
        """The scenes of vectors (B, D), with no object inside the ground."""
        return [self._scene(row) for row in np.clip(x, 0, 1) * self.span + self.low]

    def _scene(self, values: np.ndarray) -> Scene:
        camera = self.start.camera
        assert camera is not None
        own: list[dict[str, dict[int, float]]] = [{} for _ in self.start.objects]
        scene: dict[str, float] = {}
        for value, (_, index, name, part) in zip(values, self.keys, strict=True):
            if index < 0:
                scene[name] = float(value)
            else:
                own[index].setdefault(name, {})[part] = float(value)
        objects = []
        for obj, fields in zip(self.start.objects, own, strict=True):
            changed: dict[str, Any] = {}
            for name, parts in fields.items():
                if name == "turn":
                    changed["orientation"] = tuple(_turned(obj.orientation, parts))
                elif name == "log_mass":
                    changed["mass"] = float(np.exp(parts[0]))
                else:
                    old = getattr(obj, name)
                    vector = isinstance(old, tuple)
                    changed[name] = tuple(parts.get(i, v) for i, v in enumerate(old)) if vector else parts[0]
            objects.append(_above_ground(replace(obj, **changed), self.start.ground))
        x, y, _ = camera.position
        return Scene(
            tuple(objects),
            replace(camera, position=(x, y, scene["camera_height"]), pitch=scene["camera_pitch"], fov=scene["fov"]),
            (0.0, 0.0, -scene["gravity"]),
            self.start.ground,
        )


def _above_ground(obj: SceneObject, ground: float | None) -> SceneObject:
    if ground is None:
        return obj
    x, y, z = obj.position
    return replace(obj, position=(x, y, max(z, ground + reach_below(obj))))


def _turned(orientation: tuple[float, ...], parts: dict[int, float]) -> np.ndarray:
    """The orientation after the rotation vector `parts`, rad, about the world's axes (x, y, and z where free)."""
    vector = np.array([parts.get(i, 0.0) for i in range(3)])
    angle = np.linalg.norm(vector)
    if angle < 1e-12:
        return np.array(orientation)
    turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * vector / angle])
    return quaternion_multiply(turn, np.array(orientation))


def search_space(start: Scene) -> Space:
    """Everything but the types: camera, gravity, and of every object size, material and motion."""
    keys: list[tuple[str, int, str, int]] = [(k, -1, k, 0) for k in ("camera_height", "camera_pitch", "fov", "gravity")]
    for i, obj in enumerate(start.objects):
        keys += [("size", i, "size", part) for part in range(len(SIZE_KEYS[obj.shape]))]
        keys += [(k, i, k, 0) for k in ("log_mass", "sliding_friction", "rolling_friction", "damping")]
        keys += [(axis, i, "position", part) for part, axis in enumerate("xyz")]
        keys += [(k, i, k, part) for k in ("velocity", "angular_velocity") for part in range(3)]
        keys += [("turn", i, "turn", part) for part in range(TURNS[obj.shape])]
    return Space(start, tuple(keys))
