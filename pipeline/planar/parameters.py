"""What a planar fit may change in a scene: states, contacts, supports and gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.planar.plane import Plane
from pipeline.scene.scene import HOLLOW_SHAPES, FixedBody, Scene, SceneObject

MOST_HOLLOW = 0.98
Change = Callable[[Scene, float], Scene]


@dataclass(frozen=True)
class Parameter:
    """A number of the scene that is fitted, as its difference from the start.

    Attributes:
        name: "objects[0].velocity.x" and the like; "log" before a number that is changed by a factor.
        step: Of finite differences.
        prior: Standard deviation of the difference.
        change: Adds a difference to a scene.
    """

    name: str
    step: float
    prior: float
    change: Change


def planar_parameters(scene: Scene, plane: Plane, *, gravity: bool = True, hollow: bool = False) -> list[Parameter]:
    """The parameters of a planar scene: first what every scene has, then what matters where bodies touch.

    Args:
        scene: The start.
        plane: In which bodies move.
        gravity: It is fitted: either it fixes the scale, so that lengths follow from it, or a length is known.
        hollow: How hollow a rolling body is is fitted: where gravity and a length are known, its acceleration tells.
    """
    px = 1 / plane.px_per_m
    touching = bool(scene.fixed) or plane.level or len(scene.objects) > 1
    out = [Parameter("log gravity", 0.02, 0.3, _gravity)] if gravity else []
    for i, body in enumerate(scene.objects):
        size, speed = float(max(body.size)), float(np.linalg.norm(body.velocity))
        name = f"objects[{i}]"
        for axis in "xy" if plane.level else "xz":
            part = "xyz".index(axis)
            out.append(Parameter(f"{name}.position.{axis}", 1.5 * px, 0.5 * size, _position(i, part)))
            if speed:
                out.append(Parameter(f"{name}.velocity.{axis}", 6 * px, 0.5 * speed + 3 * px, _velocity(i, part)))
        if touching:
            out.append(Parameter(f"log {name}.sliding_friction", 0.1, 1.0, _log("sliding_friction", i)))
            out.append(Parameter(f"log {name}.damping", 0.1, 0.7, _log("damping", i)))
        if body.rolling_friction:
            out.append(Parameter(f"log {name}.rolling_friction", 0.2, 1.0, _log("rolling_friction", i)))
        if hollow and body.shape in HOLLOW_SHAPES and any(body.angular_velocity):
            out.append(Parameter(f"{name}.hollow²", 0.05, 0.5, _hollow(i)))
        if len(scene.objects) > 1:
            out.append(Parameter(f"log {name}.size", 0.01, 0.015, _size(i)))
            if i:
                out.append(Parameter(f"log {name}.mass", 0.1, 0.7, _log("mass", i)))
    for k, support in enumerate(scene.fixed):
        thickness, length = support.size[2], support.size[0]
        into, axis = (1, "z") if plane.level else (2, "y")
        out.append(Parameter(f"fixed[{k}].offset", 0.5 * px, 0.1 * thickness, _shift(k, into)))
        out.append(Parameter(f"fixed[{k}].end", 2 * px, 0.05 * length, _shift(k, 0)))
        out.append(Parameter(f"fixed[{k}].angle", 0.004, 0.2 if plane.level else 0.03, _turn(k, axis)))
        if support.damping is not None:
            out.append(Parameter(f"log fixed[{k}].damping", 0.1, 0.7, _bouncing(k)))
    return out


def _gravity(scene: Scene, difference: float) -> Scene:
    x, y, z = scene.gravity
    factor = float(np.exp(difference))
    return replace(scene, gravity=(x * factor, y * factor, z * factor))


def _position(index: int, part: int) -> Change:
    def edit(body: SceneObject, difference: float) -> SceneObject:
        return replace(body, position=_moved(body.position, part, difference))

    return _of_object(index, edit)


def _velocity(index: int, part: int) -> Change:
    """Of a rolling body, the spin changes with the velocity."""

    def edit(body: SceneObject, difference: float) -> SceneObject:
        velocity = _moved(body.velocity, part, difference)
        spin = body.angular_velocity
        if any(spin):
            before = np.array(body.velocity)
            size = max(float(before @ before), 1e-18)
            ratio = float(np.linalg.norm(velocity)) / np.sqrt(size)
            turn = np.cross(before, velocity) / size
            spin = tuple(ratio * np.array(spin) + np.cross(turn, spin))
        return replace(body, velocity=velocity, angular_velocity=spin)

    return _of_object(index, edit)


def _size(index: int) -> Change:
    def edit(body: SceneObject, difference: float) -> SceneObject:
        return replace(body, size=tuple(float(np.exp(difference)) * s for s in body.size))

    return _of_object(index, edit)


def _hollow(index: int) -> Change:
    """The square of the ratio of radii, on which inertia depends most evenly."""

    def edit(body: SceneObject, difference: float) -> SceneObject:
        square = float(np.clip(body.hollow**2 + difference, 0.0, MOST_HOLLOW**2))
        return replace(body, hollow=float(np.sqrt(square)))

    return _of_object(index, edit)


def _log(name: str, index: int) -> Change:
    def edit(body: SceneObject, difference: float) -> SceneObject:
        return replace(body, **{name: float(getattr(body, name) * np.exp(difference))})  # type: ignore[arg-type]

    return _of_object(index, edit)


def _shift(index: int, part: int) -> Change:
    """Along an axis of the support's own frame."""

    def edit(body: FixedBody, difference: float) -> FixedBody:
        axis = Rotation.from_quat(body.orientation, scalar_first=True).as_matrix()[:, part]
        return replace(body, position=tuple(np.array(body.position) + difference * axis))

    return _of_fixed(index, edit)


def _bouncing(index: int) -> Change:
    def edit(body: FixedBody, difference: float) -> FixedBody:
        assert body.damping is not None
        return replace(body, damping=float(body.damping * np.exp(difference)))

    return _of_fixed(index, edit)


def _turn(index: int, axis: str) -> Change:
    """About an axis of the world, through the support's centre."""

    def edit(body: FixedBody, difference: float) -> FixedBody:
        turn = Rotation.from_euler(axis, difference) * Rotation.from_quat(body.orientation, scalar_first=True)
        return replace(body, orientation=tuple(turn.as_quat(canonical=True, scalar_first=True)))

    return _of_fixed(index, edit)


def _moved(vector: tuple[float, ...], part: int, difference: float) -> tuple[float, ...]:
    return tuple(v + difference * (k == part) for k, v in enumerate(vector))


def _of_object(index: int, edit: Callable[[SceneObject, float], SceneObject]) -> Change:
    def change(scene: Scene, difference: float) -> Scene:
        bodies = (edit(b, difference) if i == index else b for i, b in enumerate(scene.objects))
        return replace(scene, objects=tuple(bodies))

    return change


def _of_fixed(index: int, edit: Callable[[FixedBody, float], FixedBody]) -> Change:
    def change(scene: Scene, difference: float) -> Scene:
        bodies = (edit(b, difference) if i == index else b for i, b in enumerate(scene.fixed))
        return replace(scene, fixed=tuple(bodies))

    return change
