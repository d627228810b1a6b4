"""What a planar fit may change in a scene: states, contacts, supports and gravity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import HOLLOW_SHAPES, Scene
from pipeline.worlds.plane import Plane

MOST_HOLLOW = 0.98
Fields = dict[str, Any]  # of a body or of the scene, by the name of the attribute
Edit = Callable[[Fields, float], None]


@dataclass(frozen=True)
class Parameter:
    """A number of the scene that is fitted, as its difference from the start.

    Attributes:
        name: "objects[0].velocity.x" and the like; "log" before a number that is changed by a factor.
        step: Of finite differences.
        prior: Standard deviation of the difference.
        place: What it belongs to: ("objects", 0), ("fixed", 0), or ("scene", 0).
        edit: Adds a difference to the fields of that.
    """

    name: str
    step: float
    prior: float
    place: tuple[str, int]
    edit: Edit


def changed(scene: Scene, parameters: Sequence[Parameter], x: np.ndarray) -> Scene:
    """The scene with the differences x (P,) of its parameters, each body built but once."""
    edited: dict[tuple[str, int], Fields] = {}
    for value, parameter in zip(x, parameters, strict=True):
        if value:
            kind, index = parameter.place
            if parameter.place not in edited:
                edited[parameter.place] = dict(vars(scene if kind == "scene" else getattr(scene, kind)[index]))
            parameter.edit(edited[parameter.place], float(value))
    if not edited:
        return scene

    def bodies(kind: str) -> tuple[Any, ...]:
        return tuple(
            replace(b, **edited[kind, i]) if (kind, i) in edited else b for i, b in enumerate(getattr(scene, kind))
        )

    world = edited.get(("scene", 0), {"gravity": scene.gravity})
    return replace(scene, objects=bodies("objects"), fixed=bodies("fixed"), gravity=world["gravity"])


def planar_parameters(
    scene: Scene,
    plane: Plane,
    along: Sequence[np.ndarray | None],
    *,
    gravity: bool = True,
    hollow: bool = False,
) -> list[Parameter]:
    """The parameters of a planar scene: first what every scene has, then what matters where bodies touch.

    Args:
        scene: The start.
        plane: In which bodies move.
        along: Of each object, the direction (3,) in which a support lets it begin; None: any direction.
        gravity: It is fitted: either it fixes the scale, so that lengths follow from it, or a length is known.
        hollow: How hollow a rolling body is is fitted: where gravity and a length are known, its acceleration tells.
    """
    px = 1 / plane.px_per_m
    touching = bool(scene.fixed) or plane.level or len(scene.objects) > 1
    out = [Parameter("log gravity", 0.02, 0.3, ("scene", 0), _gravity)] if gravity else []
    for i, body in enumerate(scene.objects):
        size, speed = float(max(body.size)), float(np.linalg.norm(body.velocity))
        name, place = f"objects[{i}]", ("objects", i)
        axes = "xy" if plane.level else "xz"
        for axis in axes:
            way = np.eye(3)["xyz".index(axis)]
            out.append(Parameter(f"{name}.position.{axis}", 1.5 * px, 0.5 * size, place, _moving("position", way)))
        only = along[i]
        ways = {axis: np.eye(3)["xyz".index(axis)] for axis in axes} if only is None else {"along": only}
        for axis, way in ways.items() if speed else ():
            out.append(Parameter(f"{name}.velocity.{axis}", 6 * px, 0.5 * speed + 3 * px, place, _velocity(way)))
        if touching:
            out.append(Parameter(f"log {name}.sliding_friction", 0.1, 1.0, place, _log("sliding_friction")))
            out.append(Parameter(f"log {name}.damping", 0.1, 0.7, place, _log("damping")))
        if body.rolling_friction:
            out.append(Parameter(f"log {name}.rolling_friction", 0.2, 1.0, place, _log("rolling_friction")))
        if hollow and body.shape in HOLLOW_SHAPES and any(body.angular_velocity):
            out.append(Parameter(f"{name}.hollow²", 0.05, 0.5, place, _hollow))
        if len(scene.objects) > 1:
            out.append(Parameter(f"log {name}.size", 0.01, 0.015, place, _size))
            if i:
                out.append(Parameter(f"log {name}.mass", 0.1, 0.7, place, _log("mass")))
    for k, support in enumerate(scene.fixed):
        thickness, length, place = support.size[2], support.size[0], ("fixed", k)
        into, axis = (1, "z") if plane.level else (2, "y")
        out.append(Parameter(f"fixed[{k}].offset", 0.5 * px, 0.1 * thickness, place, _shift(into)))
        out.append(Parameter(f"fixed[{k}].end", 2 * px, 0.05 * length, place, _shift(0)))
        out.append(Parameter(f"fixed[{k}].angle", 0.004, 0.2 if plane.level else 0.03, place, _turn(axis)))
        if support.damping is not None:
            out.append(Parameter(f"log fixed[{k}].damping", 0.1, 0.7, place, _log("damping")))
    return out


def _gravity(scene: Fields, difference: float) -> None:
    scene["gravity"] = tuple(float(np.exp(difference)) * g for g in scene["gravity"])


def _moving(key: str, way: np.ndarray) -> Edit:
    def edit(body: Fields, difference: float) -> None:
        body[key] = _moved(body[key], way, difference)

    return edit


def _velocity(way: np.ndarray) -> Edit:
    """Of a rolling body, the spin changes with the velocity."""

    def edit(body: Fields, difference: float) -> None:
        before, spin = body["velocity"], body["angular_velocity"]
        body["velocity"] = _moved(body["velocity"], way, difference)
        if any(spin):
            size = max(math.hypot(*before) ** 2, 1e-18)
            ratio = math.hypot(*body["velocity"]) / math.sqrt(size)
            turn = [part / size for part in _cross(before, body["velocity"])]
            swept = _cross(turn, spin)
            body["angular_velocity"] = tuple(ratio * s + c for s, c in zip(spin, swept, strict=True))

    return edit


def _size(body: Fields, difference: float) -> None:
    body["size"] = tuple(float(np.exp(difference)) * s for s in body["size"])


def _hollow(body: Fields, difference: float) -> None:
    """The square of the ratio of radii, on which inertia depends most evenly."""
    square = float(np.clip(body["hollow"] ** 2 + difference, 0.0, MOST_HOLLOW**2))
    body["hollow"] = float(np.sqrt(square))


def _log(key: str) -> Edit:
    def edit(body: Fields, difference: float) -> None:
        body[key] = float(body[key] * np.exp(difference))

    return edit


def _shift(part: int) -> Edit:
    """Along an axis of the support's own frame."""

    def edit(body: Fields, difference: float) -> None:
        axis = matrix_from_quaternion(np.array(body["orientation"]))[:, part]
        body["position"] = _moved(body["position"], axis, difference)

    return edit


def _turn(axis: str) -> Edit:
    """About an axis of the world, through the support's centre."""
    way = np.eye(3)["xyz".index(axis)]

    def edit(body: Fields, difference: float) -> None:
        turn = quaternion_from_rotation_vector(difference * way)
        body["orientation"] = tuple(quaternion_multiply(turn, np.array(body["orientation"])).tolist())

    return edit


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    """Of two vectors; `numpy.cross` takes ten times as long for so few numbers."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _moved(vector: tuple[float, ...], way: np.ndarray, difference: float) -> tuple[float, ...]:
    return tuple(v + difference * w for v, w in zip(vector, way.tolist(), strict=True))
