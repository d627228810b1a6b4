"""Changes of a scene's numbers by their paths, as `objects[0].mass=2`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from pipeline.errors import SceneError, did_you_mean
from pipeline.scene.scene import CONTACT_KEYS, HOLLOW_SHAPES, JOINT_KEYS, Scene
from pipeline.scene.text import scene_from_dict, write_scene
from pipeline.untrusted import parse_yaml

#: Keys that may be set though the canonical text leaves them out, by place; those of bodies are in `_absent`.
ABSENT = {"": ("camera", "ground", "fixed"), "camera": ("pitch", "orientation"), "ground": ("height",)}
#: Keys of the camera of which there is one.
EITHER: dict[str | int, str] = {"pitch": "orientation", "orientation": "pitch"}
_FORM = "objects[0].mass=2, objects[ball].velocity=[1, 0, 0], objects[0].position[2]=0.5, gravity=3.7"
_STEP = re.compile(r"\.?([A-Za-z_][A-Za-z0-9_]*)|\[([^\[\]]+)\]")


def edited(scene: Scene, edits: Sequence[str]) -> Scene:
    """The scene after edits `path=value`, in order, as `objects[0].mass=2`; values are YAML.

    An object is named by its index or its name. Raises SceneError, which names the edit and what is valid there.
    """
    data = parse_yaml(write_scene(scene), "the scene", SceneError)
    for edit in edits:
        path, equals, value = edit.partition("=")
        if not equals or not path.strip():
            raise SceneError(f"{edit}: path=value is expected, as {_FORM}")
        _put(data, _steps(path.strip(), edit), _value(value, edit), edit)
    try:
        return scene_from_dict(data, "the edited scene")
    except SceneError as error:
        raise SceneError(f"{' '.join(edits)}: {error}") from None


def _value(text: str, edit: str) -> Any:
    try:
        return parse_yaml(text, edit, SceneError)
    except SceneError:
        raise SceneError(f"{edit}: {text!r} is no value; valid: a number, or a list as [1, 0, 0]") from None


def _steps(path: str, edit: str) -> list[str | int]:
    """`objects[0].mass` as ["objects", 0, "mass"]."""
    steps: list[str | int] = []
    position = 0
    while position < len(path):
        match = _STEP.match(path, position)
        if match is None or (position == 0 and match[2] is not None):
            raise SceneError(f"{edit}: {path!r} is no path; valid are paths as in {_FORM}")
        steps.append(match[1] or (int(match[2]) if match[2].lstrip("-").isdigit() else match[2].strip()))
        position = match.end()
    return steps


def _put(data: Any, steps: Sequence[str | int], value: Any, edit: str) -> None:
    """Set the place that `steps` lead to; every one of them has to be there."""
    at, place = data, ""
    for depth, step in enumerate(steps):
        last = depth == len(steps) - 1
        if isinstance(at, dict):
            key: str | int = _key(at, step, place, edit)
        elif isinstance(at, list):
            key = _index(at, step, place, edit)
        else:
            raise SceneError(f"{edit}: {place} is {at!r}, which has no parts")
        if last:
            at[key] = value
            if place == "camera" and key in EITHER:
                at.pop(EITHER[key], None)
            return
        place = f"{place}[{key}]" if isinstance(key, int) else f"{place}.{key}".lstrip(".")
        if isinstance(at, dict) and at.get(str(key)) is None:
            at[key] = {}  # `camera: null`, of which a part is set
        at = at[key]


def _key(at: dict[str, Any], step: str | int, place: str, edit: str) -> str:
    valid = list(dict.fromkeys([*at, *_absent(at, place)]))
    if isinstance(step, str) and step in valid:
        return step
    hint = did_you_mean(step, valid)
    where = f" of {place}" if place else ""
    shape = f", a {at['shape']}," if "shape" in at else ""
    raise SceneError(f"{edit}: unknown key {str(step)!r}{where}{shape}{hint}; valid: {', '.join(valid)}")


def _absent(at: dict[str, Any], place: str) -> tuple[str, ...]:
    """Keys that may be missing at a place of a scene's text and may be set all the same."""
    if place.startswith("fixed["):
        return CONTACT_KEYS
    if place.endswith(".joint"):
        return (*JOINT_KEYS.get(at.get("kind", ""), ()), "to")
    if "shape" in at:
        return ("hollow", "joint") if at["shape"] in HOLLOW_SHAPES else ("joint",)
    return ABSENT.get(place, ())


def _index(at: list[Any], step: str | int, place: str, edit: str) -> int:
    if isinstance(step, int) and 0 <= step < len(at):
        return step
    names = [entry.get("name") for entry in at if isinstance(entry, dict)]
    if isinstance(step, str) and step in names:
        return names.index(step)
    hint = did_you_mean(step, [n for n in names if n])
    valid = f"0 to {len(at) - 1}" if at else "none, it is empty"
    by_name = f", or by name: {', '.join(n for n in names if n)}" if any(names) else ""
    raise SceneError(f"{edit}: {place} has no [{step}]{hint}; valid: {valid}{by_name}")
