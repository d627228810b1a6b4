"""Sliders that change a scene: their ranges, and the edits that they stand for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import SceneError
from pipeline.scene.scene import Scene, SceneObject, rounded

MASS, SPEED = (0.05, 20.0), (0.0, 3.0)  # factors
FRICTION, DAMPING, GRAVITY = (0.0, 1.5), (0.02, 2.0), (0.0, 25.0)
MOST_OBJECTS = 50


class ObjectChanges(BaseModel):
    """The sliders of one object; None: as found."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    mass: Annotated[float, Field(ge=MASS[0], le=MASS[1])] | None = None
    friction: Annotated[float, Field(ge=FRICTION[0], le=FRICTION[1])] | None = None
    damping: Annotated[float, Field(ge=DAMPING[0], le=DAMPING[1])] | None = None
    speed: Annotated[float, Field(ge=SPEED[0], le=SPEED[1])] | None = None
    heading: Annotated[float, Field(ge=-180, le=180)] | None = None


class Changes(BaseModel):
    """All sliders.

    Attributes:
        gravity: m/s²; None: as found.
        objects: By name.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    gravity: Annotated[float, Field(ge=GRAVITY[0], le=GRAVITY[1])] | None = None
    objects: Annotated[dict[str, ObjectChanges], Field(max_length=MOST_OBJECTS)] = Field(default_factory=dict)


@dataclass(frozen=True)
class Slider:
    """A slider: its key in `ObjectChanges`, title, range, value as found, and whether it is a factor."""

    key: str
    title: str
    low: float
    high: float
    value: float
    unit: str = ""
    factor: bool = False


def read_changes(data: Any) -> Changes:
    """Changes from JSON. Raises SceneError, which names the first fault."""
    try:
        return Changes.model_validate(data)
    except ValidationError as error:
        fault = error.errors()[0]
        raise SceneError(f"{'.'.join(map(str, fault['loc'])) or 'changes'}: {fault['msg'].lower()}") from None


def sliders_of(obj: SceneObject) -> list[Slider]:
    """The sliders of an object; where what was found is beyond the usual range, the range reaches it."""
    return [
        Slider("mass", "mass", *MASS, value=1.0, unit="×", factor=True),
        Slider("friction", "friction", *FRICTION, value=min(obj.sliding_friction, FRICTION[1])),
        Slider("damping", "damping", *DAMPING, value=min(max(obj.damping, DAMPING[0]), DAMPING[1])),
        Slider("speed", "velocity", *SPEED, value=1.0, unit="×"),
        Slider("heading", "heading", -180.0, 180.0, value=0.0, unit="°"),
    ]


def gravity_slider(scene: Scene) -> Slider:
    """The slider of gravity, its strength as found."""
    return Slider("gravity", "gravity", *GRAVITY, value=min(strength(scene), GRAVITY[1]), unit="m/s²")


def strength(scene: Scene) -> float:
    """Of gravity, m/s²."""
    return rounded(sum(v * v for v in scene.gravity) ** 0.5)


def edits_of(scene: Scene, changes: Changes) -> list[str]:
    """The edits `path=value`, as `dynamics simulate --set` takes them, that the sliders stand for.

    A factor of mass or velocity is of what was found; the heading turns the velocity about the vertical; gravity keeps
    its direction. Raises SceneError for an object that is not there.
    """
    edits = []
    if changes.gravity is not None:
        found = strength(scene)
        down = tuple(v / found for v in scene.gravity) if found else (0.0, 0.0, -1.0)
        edits.append(f"gravity={_list(changes.gravity * v for v in down)}")
    by_name: Mapping[str, SceneObject] = {o.name: o for o in scene.objects}
    for name, change in changes.objects.items():
        if name not in by_name:
            raise SceneError(f"there is no object {name!r}; valid: {', '.join(by_name)}")
        obj, place = by_name[name], f"objects[{scene.objects.index(by_name[name])}]"
        if change.mass is not None:
            edits.append(f"{place}.mass={rounded(change.mass * obj.mass):.6g}")
        if change.friction is not None:
            edits.append(f"{place}.sliding_friction={change.friction:.6g}")
        if change.damping is not None:
            edits.append(f"{place}.damping={change.damping:.6g}")
        if change.speed is not None or change.heading is not None:
            factor = 1.0 if change.speed is None else change.speed
            turn = math.radians(change.heading or 0.0)
            x, y, z = (factor * v for v in obj.velocity)
            turned = (x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn), z)
            edits.append(f"{place}.velocity={_list(turned)}")
    return edits


def _list(values: Any) -> str:
    return f"[{', '.join(f'{rounded(v):.6g}' for v in values)}]"
