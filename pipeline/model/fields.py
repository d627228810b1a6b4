"""The numbers of a scene as the words model writes them: their order, range and scale."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.scene.canonical import rounded_scene
from pipeline.scene.scene import BASIC_SHAPES, SIZE_KEYS, Camera, Scene, SceneObject
from pipeline.scene.solid import reach_below

BINS = 65
NOTHING = len(BASIC_SHAPES)  # the class of an instance that is no body
MOTION = 9  # position (m), velocity (m/s) and spin (rad/s) of a body in a frame, learned beside the answer
LEAST_SIZE, LEAST_MASS, LEAST_DAMPING = 0.03, 0.05, 0.05
LEAST_REAL = 0.5  # of an orientation in canonical form
ON_GROUND = 0.0021  # m; less than that above the ground counts as on it
CAMERA_Y = -2.0  # m


@dataclass(frozen=True)
class Field:
    """A number.

    Attributes:
        name: Of the number.
        low: Centre of the first bin, on the field's scale.
        high: Centre of the last bin.
        scale: "linear"; "asinh", of half the number; or "log".
        zero: Whether it is often exactly 0, which then is a bin of its own.
        weight: Of its loss.
    """

    name: str
    low: float
    high: float
    scale: str = "linear"
    zero: bool = False
    weight: float = 1.0


#: Camera (deg, m), gravity (m/s²).
SCENE_FIELDS = (
    Field("pitch", -36, -6),
    Field("height", 0.45, 1.45),
    Field("fov", 27, 47),
    Field("gravity", 1.5, 12.5),
)
#: Height above the ground (m), orientation's imaginary parts, sizes (m), place, velocities, mass and contacts.
OBJECT_FIELDS = (
    Field("gap", 0, 0.64, zero=True),
    *(Field(f"q{k}", -0.8, 0.8, zero=True) for k in (1, 2, 3)),
    *(Field(f"size {k}", 0.05, 0.41) for k in (0, 1, 2)),
    Field("y", -0.75, 0.85),
    Field("x", -0.75, 0.75),
    Field("velocity x", -2.2, 2.2),
    Field("velocity y", -2.2, 2.2),
    Field("velocity z", -1.3, 1.3, zero=True),
    *(Field(f"spin {axis}", -3.4, 3.4, scale="asinh", zero=True) for axis in "xyz"),
    Field("mass", math.log(0.09), math.log(4.2), scale="log", weight=0.3),
    Field("sliding_friction", 0, 1.05, weight=0.3),
    Field("rolling_friction", 0, 0.0105, weight=0.1),
    Field("damping", 0.05, 1.05, weight=0.2),
)
AT = {f.name: k for k, f in enumerate(OBJECT_FIELDS)}
#: Which numbers each basic shape has: (shapes, fields).
FREE = np.ones((len(BASIC_SHAPES), len(OBJECT_FIELDS)), bool)
FREE[BASIC_SHAPES.index("sphere"), [AT[n] for n in ("q1", "q2", "q3", "size 1", "size 2")]] = False
FREE[BASIC_SHAPES.index("cylinder"), [AT[n] for n in ("q3", "size 2")]] = False
#: Numbers that change sign in a mirror.
MIRRORED = tuple(AT[n] for n in ("q2", "q3", "x", "velocity x", "spin y", "spin z"))


def on_scale(values: Tensor, fields: tuple[Field, ...]) -> Tensor:
    """Numbers (..., K) on the scales of their fields."""
    columns = []
    for k, field in enumerate(fields):
        v = values[..., k]
        if field.scale == "asinh":
            v = torch.asinh(v / 2)
        elif field.scale == "log":
            v = torch.log(v.clamp(min=1e-3))
        columns.append(v)
    return torch.stack(columns, -1)


def off_scale(values: Tensor, fields: tuple[Field, ...]) -> Tensor:
    """The inverse of `on_scale`."""
    columns = []
    for k, field in enumerate(fields):
        v = values[..., k]
        if field.scale == "asinh":
            v = 2 * torch.sinh(v)
        elif field.scale == "log":
            v = torch.exp(v)
        columns.append(v)
    return torch.stack(columns, -1)


def scene_numbers(scene: Scene) -> np.ndarray:
    """(4,) `SCENE_FIELDS` of a scene whose camera has a pitch."""
    camera = scene.camera
    assert camera is not None
    assert camera.pitch is not None
    return np.array([camera.pitch, camera.position[2], camera.fov, -scene.gravity[2]], np.float32)


def object_numbers(body: SceneObject) -> np.ndarray:
    """(19,) `OBJECT_FIELDS` of a body of a basic shape in canonical form."""
    gap = body.position[2] - reach_below(body)
    size = [*body.size, 0.0, 0.0][:3]
    return np.array(
        [
            0.0 if gap < ON_GROUND else gap,
            *body.orientation[1:],
            *size,
            body.position[1],
            body.position[0],
            *body.velocity,
            *body.angular_velocity,
            body.mass,
            body.sliding_friction,
            body.rolling_friction,
            body.damping,
        ],
        np.float32,
    )


def object_of(shape: str, numbers: np.ndarray) -> SceneObject:
    """The body of a shape with these numbers (19,), moved to the nearest valid ones."""
    v = [float(x) for x in numbers]
    imaginary = np.array(v[AT["q1"] : AT["q3"] + 1])
    most = math.sqrt(1 - LEAST_REAL**2)
    length = float(np.linalg.norm(imaginary))
    if length > most:
        imaginary *= most / length
    size = v[AT["size 0"] : AT["size 0"] + len(SIZE_KEYS[shape])]
    body = SceneObject(
        shape=shape,
        size=tuple(max(s, LEAST_SIZE) for s in size),
        mass=max(v[AT["mass"]], LEAST_MASS),
        sliding_friction=max(v[AT["sliding_friction"]], 0.0),
        rolling_friction=max(v[AT["rolling_friction"]], 0.0),
        damping=max(v[AT["damping"]], LEAST_DAMPING),
        velocity=tuple(v[AT["velocity x"] : AT["velocity z"] + 1]),
        angular_velocity=tuple(v[AT["spin x"] : AT["spin z"] + 1]),
        orientation=(math.sqrt(max(1 - float(imaginary @ imaginary), 0.0)), *imaginary),
    )
    height = math.ceil(1000 * (reach_below(body) + max(v[AT["gap"]], 0.0))) / 1000
    return SceneObject(**{**vars(body), "position": (v[AT["x"]], v[AT["y"]], height)})


def scene_of(numbers: np.ndarray, shapes: list[str], objects: np.ndarray) -> Scene:
    """A scene.

    Args:
        numbers: (4,) `SCENE_FIELDS`.
        shapes: (N,) names of basic shapes.
        objects: (N, 19) `OBJECT_FIELDS`.
    """
    pitch, height, fov, gravity = (float(v) for v in numbers)
    bodies = tuple(object_of(shape, values) for shape, values in zip(shapes, objects, strict=True))
    camera = Camera((0.0, CAMERA_Y, height), fov=fov, pitch=pitch)
    return rounded_scene(Scene(bodies, camera, (0.0, 0.0, -gravity)))
