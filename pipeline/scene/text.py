"""Scenes as YAML text: reading, with an error that names the first fault, and writing in one canonical form.

The format is described in docs/formats.md. Reading a written scene gives an equal scene.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from pipeline.errors import SceneError, did_you_mean
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.text import effect_from_dict
from pipeline.scene.joint import check_joints
from pipeline.scene.scene import (
    CONTACT_KEYS,
    FIXED_SIZE_KEYS,
    SIZE_KEYS,
    Camera,
    Effect,
    FixedBody,
    Joint,
    Scene,
    SceneObject,
    Spring,
)
from pipeline.scene.schema import PLACES, SHAPE_MODELS, CameraText, FixedText, JointText, ObjectText, SceneText
from pipeline.untrusted import parse_yaml, read_text

Body = TypeVar("Body", SceneObject, FixedBody)

OBJECT_KEYS = (
    "mass",
    "sliding_friction",
    "rolling_friction",
    "damping",
    "position",
    "velocity",
    "angular_velocity",
    "orientation",
)


def read_scene(text: str, source: str = "scene") -> Scene:
    """The scene that `text` describes. Raises SceneError, which names the place of the fault (`objects[1].mass`)."""
    data = parse_yaml(text, source, SceneError)
    if not isinstance(data, dict):
        raise SceneError(f"{source}: a mapping with the keys {', '.join(SceneText.model_fields)} is expected")
    return scene_from_dict(data, source)


def load_scene(path: Path | str) -> Scene:
    """The scene in a file. Mesh files are relative to its folder and in or below it. Raises SceneError."""
    scene = read_scene(read_text(Path(path), SceneError), str(path))
    folder = Path(path).resolve().parent

    def found(body: Body, place: str) -> Body:
        if body.file is None:
            return body
        file = (folder / body.file).resolve()
        if not file.is_relative_to(folder):
            raise SceneError(
                f"{path}: {place}.file: {body.file!r} is outside of the scene's folder; valid: a file in it"
            )
        return replace(body, file=str(file))

    return replace(
        scene,
        objects=tuple(found(o, f"objects[{i}]") for i, o in enumerate(scene.objects)),
        fixed=tuple(found(b, f"fixed[{i}]") for i, b in enumerate(scene.fixed)),
    )


def save_scene(scene: Scene, path: Path) -> None:
    """Write the scene's text to a file, and copies of its mesh files beside it."""

    def beside(body: Body) -> Body:
        if body.file is None:
            return body
        copy = path.parent / f"{body.name}{Path(body.file).suffix}"
        shutil.copyfile(body.file, copy)
        return replace(body, file=copy.name)

    copied = replace(scene, objects=tuple(map(beside, scene.objects)), fixed=tuple(map(beside, scene.fixed)))
    path.write_text(write_scene(copied), encoding="utf-8")


def scene_from_dict(data: dict[str, Any], source: str = "scene") -> Scene:
    """The scene that parsed YAML describes. Raises SceneError."""
    try:
        parsed = SceneText.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}: {_sentence(error, data)}") from None
    names = [o.name or f"{o.shape}_{i}" for i, o in enumerate(parsed.objects)]
    places: dict[str, str] = {}
    bodies = [(f"objects[{i}]", name) for i, name in enumerate(names)]
    bodies += [(f"fixed[{i}]", b.name or f"fixed_{i}") for i, b in enumerate(parsed.fixed)]
    for place, name in bodies:
        if name in places:
            raise SceneError(f"{source}: {place}.name: {name!r} is taken by {places[name]}")
        if name in ("world", "camera", "ground"):
            raise SceneError(f"{source}: {place}.name: {name!r} is reserved")
        places[name] = place
    gravity = parsed.gravity if isinstance(parsed.gravity, list) else (0.0, 0.0, -parsed.gravity)
    scene = Scene(
        objects=tuple(_object(o) for o in parsed.objects),
        camera=None if parsed.camera is None else _camera(parsed.camera),
        gravity=tuple(gravity),
        ground=parsed.ground.height if parsed.ground else None,
        effects=tuple(effect_from_dict(e, i, names, source) for i, e in enumerate(parsed.effects)),
        fixed=tuple(_fixed_body(b) for b in parsed.fixed),
    )
    try:
        check_joints(scene)
    except SceneError as error:
        raise SceneError(f"{source}: {error}") from None
    return scene


def _camera(c: CameraText) -> Camera:
    return Camera(tuple(c.position), c.fov, c.pitch, None if c.orientation is None else tuple(c.orientation))


def _object(o: Any) -> SceneObject:
    values: dict[str, Any] = {
        key: tuple(value) if isinstance(value := getattr(o, key), list) else value for key in OBJECT_KEYS
    }
    return SceneObject(
        shape=o.shape,
        size=tuple(getattr(o, key) for key in SIZE_KEYS[o.shape]),
        name=o.name or "",
        file=getattr(o, "file", None),
        hollow=getattr(o, "hollow", 0.0),
        joint=None if o.joint is None else _joint(o.joint),
        **values,
    )


def _joint(j: JointText) -> Joint:
    values: dict[str, Any] = {
        key: tuple(v) if isinstance(v := getattr(j, key), list) else v for key in j.model_fields_set
    }
    if j.spring is not None:
        values["spring"] = Spring(j.spring.stiffness, j.spring.rest)
    return Joint(**values)


def _fixed_body(b: Any) -> FixedBody:
    return FixedBody(
        shape=b.shape,
        size=tuple(getattr(b, key) for key in FIXED_SIZE_KEYS[b.shape]),
        position=tuple(b.position),
        orientation=tuple(b.orientation),
        name=b.name or "",
        file=getattr(b, "file", None),
        **{key: getattr(b, key) for key in CONTACT_KEYS},
    )


#: Message for each type of pydantic error; names in braces are filled in from the error's context.
_MESSAGES: dict[str, str] = {
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "literal_error": "valid: {expected}",
    "string_type": "must be a text",
    "string_pattern_mismatch": "must be a letter and then letters, digits, - or _",
    "list_type": "must be a list",
    "dict_type": "must be a mapping",
    "model_type": "must be a mapping with the keys {keys}",
    "model_attributes_type": "must be a mapping with a shape and its keys",
}
_CAMERA_KEYS = "position, pitch (or orientation), fov"


def _sentence(error: ValidationError, data: dict[str, Any]) -> str:
    """The first fault of `error` as one sentence that names its place and the valid values."""
    faults = error.errors()
    # A misspelt key is reported first: it is also the cause of a missing one.
    first = next((f for f in faults if f["type"] in ("extra_forbidden", "invalid_key")), faults[0])
    location = list(first["loc"])
    if location[:1] in (["objects"], ["fixed"]):
        del location[2:3]  # the shape: pydantic's name for the member of the union
    place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in location).removeprefix(".")
    kind, shown = first["type"], f", not {_shown(first['input'])}"
    if location[:1] == ["gravity"] and kind != "missing":
        return f"gravity: valid: a number (m/s², along -z) or a vector [x, y, z]{shown}"
    if kind in ("extra_forbidden", "invalid_key", "missing"):
        parent, key = location[:-1], str(location[-1])
        model = _model_at(parent, data)
        general = ObjectText.model_fields.keys() | FixedText.model_fields.keys()
        valid = sorted(model.model_fields, key=lambda k: k in general)  # shape and sizes first
        if kind == "missing":
            needed = ", ".join(k for k in valid if model.model_fields[k].is_required())
            return f"{place}: missing key; needed: {_CAMERA_KEYS if model is CameraText else needed}"
        body = parent[:1] in (["objects"], ["fixed"]) and len(parent) == 2
        owner = f" of a {data[str(parent[0])][parent[1]]['shape']}" if body else ""
        return f"{place}: unknown key{did_you_mean(key, valid)}; valid keys{owner}: {', '.join(valid)}"
    if kind == "absence_implicit":
        return first["msg"]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return f"{place}.shape: unknown or missing shape; valid: {', '.join(SHAPE_MODELS[str(location[0])])}"
    length = _LENGTHS.get(str(location[-1])) if location else None
    if length and kind in ("too_short", "too_long", "list_type"):
        return f"{place}: valid: a list of {length} numbers{shown}"
    if kind in _MESSAGES:
        keys = ", ".join(_model_at(location, data).model_fields) if kind == "model_type" else ""
        return f"{place}: {_MESSAGES[kind].format(**first.get('ctx', {}), keys=keys)}{shown}"
    return f"{place}: {first['msg']}"


_LENGTHS = {"position": 3, "velocity": 3, "angular_velocity": 3, "orientation": 4, "anchor": 3, "axis": 3, "end": 3}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _model_at(parent: list[Any], data: dict[str, Any]) -> type[BaseModel]:
    if parent[:1] in (["objects"], ["fixed"]):
        if parent[2:]:
            return PLACES[".".join(parent[2:])]
        return SHAPE_MODELS[str(parent[0])][data[str(parent[0])][parent[1]]["shape"]]
    return PLACES[".".join(map(str, parent))]


def number_text(value: float) -> str:
    """The shortest text that reads back as `value`."""
    text = repr(float(value))
    return text[:-2] if text.endswith(".0") and abs(value) >= 1e6 else text


def _vector_text(values: Sequence[float]) -> str:
    return "[" + ", ".join(number_text(v) for v in values) + "]"


def _name_text(name: str) -> str:
    return _quoted(name) if name.lower() in ("null", "true", "false") else name


def _quoted(text: str) -> str:
    """`text` as a double-quoted YAML scalar on one line; characters that cannot be printed are escaped."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def effect_text(effect: Effect) -> str:
    """An effect as a mapping on one line: `{name: air_drag, coefficient: 0.003, objects: [ball]}`."""
    parts = [f"name: {effect.name}"]
    parts += [f"{k}: {_vector_text(v) if isinstance(v, tuple) else number_text(v)}" for k, v in effect.parameters]
    if effect.objects is not None:
        parts.append(f"objects: [{', '.join(map(_name_text, effect.objects))}]")
    if effect.only is not None:
        parts.append(f"only: {_region_text(effect.only)}")
    return "{" + ", ".join(parts) + "}"


def _region_text(region: Region) -> str:
    """Where an effect acts as a mapping on one line."""
    parts = []
    for key, value in region.as_dict().items():
        if isinstance(value, dict):
            inner = ", ".join(
                f"{k}: {_vector_text(v) if isinstance(v, list) else number_text(v)}" for k, v in value.items()
            )
            parts.append(f"{key}: {{{inner}}}")
        elif isinstance(value, list):
            parts.append(f"{key}: [{', '.join(map(_quoted, value))}]")
        else:
            parts.append(f"{key}: {number_text(value)}")
    return "{" + ", ".join(parts) + "}"


def joint_text(joint: Joint) -> str:
    """A joint as a mapping on one line: `{kind: rope, anchor: [0.0, 0.0, 1.0], length: 0.5}`."""
    parts = [f"kind: {joint.kind}", f"anchor: {_vector_text(joint.anchor)}"]
    parts += [f"{key}: {_vector_text(v)}" for key in ("axis", "end") if (v := getattr(joint, key)) is not None]
    if joint.length is not None:
        parts.append(f"length: {number_text(joint.length)}")
    if joint.spring is not None:
        stiffness, rest = number_text(joint.spring.stiffness), number_text(joint.spring.rest)
        parts.append(f"spring: {{stiffness: {stiffness}, rest: {rest}}}")
    parts += [f"{key}: {number_text(v)}" for key in ("damping", "friction") if (v := getattr(joint, key))]
    if joint.to is not None:
        parts.append(f"to: {_name_text(joint.to)}")
    return "{" + ", ".join(parts) + "}"


def _body_text(body: SceneObject | FixedBody, size_keys: Mapping[str, tuple[str, ...]]) -> list[str]:
    """The first lines of a body: its name, shape and sizes."""
    lines = [f"- name: {_name_text(body.name)}", f"  shape: {body.shape}"]
    if body.file is not None:
        lines.append(f"  file: {_quoted(body.file)}")
    return lines + [f"  {key}: {number_text(v)}" for key, v in zip(size_keys[body.shape], body.size, strict=True)]


def write_scene(scene: Scene) -> str:
    """`scene` as canonical YAML text."""
    lines = []
    if scene.camera is None:
        lines.append("camera: null")
    else:
        c = scene.camera
        pitch = "" if c.pitch is None else f"pitch: {number_text(c.pitch)}, "
        turn = "" if c.orientation is None else f"orientation: {_vector_text(c.orientation)}, "
        lines.append(f"camera: {{position: {_vector_text(c.position)}, {pitch}{turn}fov: {number_text(c.fov)}}}")
    down = scene.gravity[0] == scene.gravity[1] == 0
    lines.append("gravity: " + (number_text(-scene.gravity[2] + 0.0) if down else _vector_text(scene.gravity)))
    lines.append("ground: " + ("null" if scene.ground is None else f"{{height: {number_text(scene.ground)}}}"))
    if scene.fixed:
        lines.append("fixed:")
    for b in scene.fixed:
        lines += _body_text(b, FIXED_SIZE_KEYS)
        own = [f"  {key}: {number_text(v)}" for key in CONTACT_KEYS if (v := getattr(b, key)) is not None]
        lines += [f"  position: {_vector_text(b.position)}", f"  orientation: {_vector_text(b.orientation)}", *own]
    lines.append("objects:" if scene.objects else "objects: []")
    for o in scene.objects:
        lines += _body_text(o, SIZE_KEYS)
        if o.hollow:
            lines.append(f"  hollow: {number_text(o.hollow)}")
        for key in OBJECT_KEYS:
            value = getattr(o, key)
            lines.append(f"  {key}: {_vector_text(value) if isinstance(value, tuple) else number_text(value)}")
        if o.joint is not None:
            lines.append(f"  joint: {joint_text(o.joint)}")
    lines.append("effects:" if scene.effects else "effects: []")
    lines += [f"- {effect_text(e)}" for e in scene.effects]
    return "\n".join(lines) + "\n"
