"""The known scene: a scene file with few required keys, the parameters to fit, and the overrides of single clips."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.errors import SceneError
from pipeline.scene.scene import Scene
from pipeline.scene.text import scene_from_dict
from pipeline.untrusted import parse_yaml, read_text

FITTED = ("sliding_friction", "rolling_friction", "damping")
"""Parameters of objects that are fitted unless the text has `fit`."""
SCENE_FITTABLE = ("gravity",)
"""Parameters of the whole scene that may be fitted."""
FITTABLE = (*FITTED, *SCENE_FITTABLE)
OBJECT_DEFAULTS: dict[str, Any] = {
    "sliding_friction": 0.5,
    "rolling_friction": 0.0,
    "damping": 1.0,
    "position": [0.0, 0.0, 0.0],
    "velocity": [0.0, 0.0, 0.0],
    "angular_velocity": [0.0, 0.0, 0.0],
    "orientation": [1.0, 0.0, 0.0, 0.0],
}
SCENE_DEFAULTS: dict[str, Any] = {"camera": None, "gravity": 9.81, "ground": {"height": 0.0}}


@dataclass(frozen=True)
class KnownScene:
    """What is known of the measured scene.

    Attributes:
        scene: The scene as stated.
        fit: The parameters that are estimated, of `FITTABLE`.
        by_clip: Scenes of the clips that override something.

    Raises SceneError for fixed bodies, hollow objects and joints, whose motion is not modelled.
    """

    scene: Scene
    fit: tuple[str, ...] = FITTED
    by_clip: Mapping[str, Scene] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for scene in (self.scene, *self.by_clip.values()):
            if scene.fixed:
                raise SceneError("fixed: motion on or against fixed bodies cannot be explained; valid: ground alone")
            for i, obj in enumerate(scene.objects):
                if obj.hollow:
                    raise SceneError(f"objects[{i}].hollow: motion of hollow bodies cannot be explained; valid: 0")
                if obj.joint is not None:
                    raise SceneError(
                        f"objects[{i}].joint: a table of a body with a joint cannot be explained; valid: a log and its "
                        "MJCF (dynamics discover LOG MODEL.xml)"
                    )

    def of_clip(self, clip: str) -> Scene:
        """The scene with the overrides of a clip."""
        return self.by_clip.get(clip, self.scene)


def load_known_scene(path: Path) -> KnownScene:
    """Read a scene file of which only each object's name, shape, sizes and mass are required. Raises `SceneError`."""
    data = parse_yaml(read_text(path, SceneError), str(path), SceneError)
    if not isinstance(data, dict):
        raise SceneError(f"{path}: a mapping with the key objects is expected")
    return known_scene(data, str(path))


def known_scene(data: Mapping[str, Any], source: str = "scene") -> KnownScene:
    """The known scene that parsed YAML describes. Raises `SceneError` naming the place."""
    rest = {key: value for key, value in data.items() if key not in ("fit", "clips")}
    fit = _fit(data.get("fit"), source)
    by_clip = {}
    overrides = data.get("clips") or {}
    if not isinstance(overrides, dict):
        raise SceneError(f"{source}: clips: must be a mapping of clips to what they override")
    for clip, own in overrides.items():
        by_clip[str(clip)] = _scene(_overridden(rest, own, f"{source}: clips.{clip}"), f"{source}: clips.{clip}")
    return KnownScene(_scene(rest, source), fit, by_clip)


def _scene(data: Mapping[str, Any], source: str) -> Scene:
    filled = {**SCENE_DEFAULTS, **data}
    if isinstance(filled.get("objects"), list):
        filled["objects"] = [{**OBJECT_DEFAULTS, **o} if isinstance(o, dict) else o for o in filled["objects"]]
    scene = scene_from_dict(filled, source)
    if not scene.objects:
        raise SceneError(f"{source}: objects: there are none")
    return scene


def _fit(value: Any, source: str) -> tuple[str, ...]:
    if value is None:
        return FITTED
    if not isinstance(value, list):
        raise SceneError(f"{source}: fit: must be a list, not {value!r}; valid: {', '.join(FITTABLE)}")
    for i, name in enumerate(value):
        if name not in FITTABLE:
            raise SceneError(f"{source}: fit[{i}]: {name!r} cannot be fitted; valid: {', '.join(FITTABLE)}")
    return tuple(value)


def _overridden(data: Mapping[str, Any], own: Any, place: str) -> dict[str, Any]:
    out = copy.deepcopy(dict(data))
    if not isinstance(own, dict):
        raise SceneError(f"{place}: must be a mapping of what the clip overrides")
    for key, value in own.items():
        if key != "objects":
            if key not in ("gravity", "ground"):
                raise SceneError(f"{place}.{key}: cannot be overridden; valid: gravity, ground, objects")
            out[key] = value
            continue
        objects = {o.get("name"): o for o in out.get("objects", []) if isinstance(o, dict)}
        for name, change in _pairs(value, place):
            if name not in objects:
                raise SceneError(f"{place}.objects: there is no object {name!r}; valid: {', '.join(map(str, objects))}")
            objects[name].update(change)
    return out


def _pairs(value: Any, place: str) -> Iterable[tuple[str, dict[str, Any]]]:
    if not isinstance(value, dict) or not all(isinstance(v, dict) for v in value.values()):
        raise SceneError(f"{place}.objects: must be a mapping of names to what changes")
    return value.items()
