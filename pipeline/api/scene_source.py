"""A scene from what the user gives: a file, an answer or a folder; with edits, and a camera where it has none."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import SceneError, did_you_mean
from pipeline.language.completion import read_completion
from pipeline.scene.mjcf import mesh_vertices
from pipeline.scene.scene import CONTACT_KEYS, HOLLOW_SHAPES, Camera, Scene, SceneObject, half_extents
from pipeline.scene.text import load_scene, scene_from_dict, write_scene
from pipeline.untrusted import parse_yaml, read_bytes

SCENE_FILE = "scene.yaml"
FOV, PITCH = 40.0, -22.0  # deg, of the camera that is made
#: Keys that may be set though the canonical text leaves them out, by place; those of bodies are in `_absent`.
ABSENT = {"": ("camera", "ground", "fixed"), "camera": ("pitch", "orientation"), "ground": ("height",)}
#: Keys of the camera of which there is one.
EITHER: dict[str | int, str] = {"pitch": "orientation", "orientation": "pitch"}
_FORM = "objects[0].mass=2, objects[ball].velocity=[1, 0, 0], objects[0].position[2]=0.5, gravity=3.7"
_STEP = re.compile(r"\.?([A-Za-z_][A-Za-z0-9_]*)|\[([^\[\]]+)\]")


def read_scene_source(place: Path) -> Scene:
    """The scene of a YAML file, of a model's answer (with its `<answer>`), or of a folder that `dynamics` wrote.

    Raises SceneError.
    """
    if place.is_dir():
        if not (place / SCENE_FILE).is_file():
            raise SceneError(f"{place} has no {SCENE_FILE}; give a scene file, or a folder that `dynamics infer` wrote")
        return load_scene(place / SCENE_FILE)
    if place.suffix.lower() == ".xml":
        raise SceneError(f"{place} is MJCF, which is written and not read; give the {SCENE_FILE} beside it")
    text = read_bytes(place, SceneError).decode("utf-8", errors="replace")
    if "<answer>\n" in text:
        return read_completion(text.strip()).scene
    return load_scene(place)


def with_camera(scene: Scene, positions: np.ndarray) -> tuple[Scene, str | None]:
    """The scene with a camera, and a note where one had to be made: it looks along +y and sees all of positions
    (..., 3), m, of the objects' centres."""
    if scene.camera is not None or not scene.objects:
        return scene, None
    points = positions.reshape(-1, 3)
    low, high = points.min(0), points.max(0)
    centre = (low + high) / 2
    reach = float(np.linalg.norm(high - low)) / 2 + max(_radius(o) for o in scene.objects)
    distance = 1.15 * reach / np.tan(np.radians(FOV / 2))
    pitch = np.radians(PITCH)
    eye = centre + distance * np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
    if scene.ground is not None:
        eye[2] = max(eye[2], scene.ground + 0.1 * distance)
    x, y, z = (round(float(v), 2) for v in eye)
    camera = Camera((x, y, z), fov=FOV, pitch=PITCH)
    note = f"the scene has no camera; one at ({x:g}, {y:g}, {z:g}) m sees the whole motion"
    return replace(scene, camera=camera), note


def _radius(obj: SceneObject) -> float:
    """Of a sphere about the centre that holds the body, m."""
    if obj.shape == "mesh":
        assert obj.file is not None
        return float(np.linalg.norm(mesh_vertices(obj.file), axis=1).max()) * obj.size[0]
    return float(np.linalg.norm(half_extents(obj)))


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
    if place.startswith("objects[") and at.get("shape") in HOLLOW_SHAPES:
        return ("hollow",)
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
