"""Scenes as YAML text: reading, with an error that names the first fault, and writing in one canonical form.

The format is described in docs/formats.md. Reading a written scene gives an equal scene.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pipeline.errors import SceneError, did_you_mean
from pipeline.scene.effects.text import effect_from_dict
from pipeline.scene.scene import SIZE_KEYS, Camera, Effect, Scene, SceneObject

Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[float, Field(allow_inf_nan=False, strict=True, gt=0)]
NonNegative = Annotated[float, Field(allow_inf_nan=False, strict=True, ge=0)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]

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


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


def _nonzero_quaternion(value: list[float] | None) -> list[float] | None:
    if value is not None and math.hypot(*value) == 0:
        raise PydanticCustomError("quaternion", "a quaternion must be non-zero; valid: w, x, y, z that are not all 0")
    return value


class _CameraText(_Strict):
    position: Vector
    pitch: Annotated[float, Field(strict=True, ge=-90, le=90)] | None = None
    orientation: Quaternion | None = None
    fov: Annotated[float, Field(strict=True, gt=0, lt=180)]

    _check = field_validator("orientation")(_nonzero_quaternion)

    @model_validator(mode="after")
    def _one_direction(self) -> _CameraText:
        if (self.pitch is None) == (self.orientation is None):
            raise PydanticCustomError("direction", "give either pitch (deg) or orientation (quaternion w, x, y, z)")
        return self


class _GroundText(_Strict):
    height: Number


class _ObjectText(_Strict):
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")] | None = None
    mass: Positive
    sliding_friction: NonNegative
    rolling_friction: NonNegative
    damping: Positive  # MuJoCo divides by it
    position: Vector
    velocity: Vector
    angular_velocity: Vector
    orientation: Quaternion

    _check = field_validator("orientation")(_nonzero_quaternion)


class _Sphere(_ObjectText):
    shape: Literal["sphere"]
    radius: Positive


class _Cylinder(_ObjectText):
    shape: Literal["cylinder"]
    radius: Positive
    height: Positive


class _Box(_ObjectText):
    shape: Literal["box"]
    width: Positive
    depth: Positive
    height: Positive


class _Capsule(_ObjectText):
    shape: Literal["capsule"]
    radius: Positive
    height: Positive

    @model_validator(mode="after")
    def _caps_fit(self) -> _Capsule:
        if self.height <= 2 * self.radius:
            raise PydanticCustomError("capsule", "height includes both caps; valid: more than twice the radius")
        return self


class _Ellipsoid(_ObjectText):
    shape: Literal["ellipsoid"]
    width: Positive
    depth: Positive
    height: Positive


class _Mesh(_ObjectText):
    shape: Literal["mesh"]
    file: str
    scale: Positive


class _SceneText(_Strict):
    camera: _CameraText | None = None
    gravity: Number | Vector
    ground: _GroundText | None = None
    objects: list[Annotated[_Sphere | _Cylinder | _Box | _Capsule | _Ellipsoid | _Mesh, Field(discriminator="shape")]]
    effects: list[Any] = []  # read by pipeline.scene.effects.text

    @model_validator(mode="before")
    @classmethod
    def _absence_is_explicit(cls, data: Any) -> Any:
        for key, form in (("camera", "{position, pitch, fov}"), ("ground", "{height: 0.0}")):
            if isinstance(data, dict) and key not in data and data.keys() <= cls.model_fields.keys():
                message = f"{key}: missing key; valid: {form}, or null for none"
                raise PydanticCustomError("absence_implicit", "{message}", {"message": message})
        return data


_SHAPE_MODELS = {
    m.model_fields["shape"].annotation.__args__[0]: m  # type: ignore[union-attr]
    for m in (_Sphere, _Cylinder, _Box, _Capsule, _Ellipsoid, _Mesh)
}
_PLACES: dict[str, type[BaseModel]] = {"": _SceneText, "camera": _CameraText, "ground": _GroundText}


def read_scene(text: str, source: str = "scene") -> Scene:
    """The scene that `text` describes. Raises SceneError, which names the place of the fault (`objects[1].mass`)."""
    try:
        data = YAML(typ="safe", pure=True).load(text)
    except (YAMLError, ValueError, LookupError, RecursionError) as error:  # the last three: bad scalars, deep nesting
        mark = getattr(error, "problem_mark", None)
        place = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise SceneError(f"{source}: not YAML{place}: {problem}") from None
    if not isinstance(data, dict):
        raise SceneError(f"{source}: a mapping with the keys {', '.join(_SceneText.model_fields)} is expected")
    return scene_from_dict(data, source)


def load_scene(path: Path | str) -> Scene:
    """The scene in a file. Paths of mesh files are relative to its folder. Raises SceneError."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read as text: {error}") from None
    scene = read_scene(text, str(path))
    folder = Path(path).resolve().parent
    return replace(
        scene, objects=tuple(o if o.file is None else replace(o, file=str(folder / o.file)) for o in scene.objects)
    )


def scene_from_dict(data: dict[str, Any], source: str = "scene") -> Scene:
    """The scene that parsed YAML describes. Raises SceneError."""
    try:
        parsed = _SceneText.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}: {_sentence(error, data)}") from None
    names = [o.name or f"{o.shape}_{i}" for i, o in enumerate(parsed.objects)]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise SceneError(f"{source}: objects[{i}].name: {name!r} is taken by objects[{names.index(name)}]")
        if name in ("world", "camera", "ground"):
            raise SceneError(f"{source}: objects[{i}].name: {name!r} is reserved")
    gravity = parsed.gravity if isinstance(parsed.gravity, list) else (0.0, 0.0, -parsed.gravity)
    return Scene(
        objects=tuple(_object(o) for o in parsed.objects),
        camera=None if parsed.camera is None else _camera(parsed.camera),
        gravity=tuple(gravity),
        ground=parsed.ground.height if parsed.ground else None,
        effects=tuple(effect_from_dict(e, i, names, source) for i, e in enumerate(parsed.effects)),
    )


def _camera(c: _CameraText) -> Camera:
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
        **values,
    )


#: Message for each type of pydantic error; names in braces are filled in from the error's context.
_MESSAGES: dict[str, str] = {
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
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
    if location[:1] == ["objects"]:
        del location[2:3]  # the shape: pydantic's name for the member of the union
    place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in location).removeprefix(".")
    kind, shown = first["type"], f", not {_shown(first['input'])}"
    if location[:1] == ["gravity"] and kind != "missing":
        return f"gravity: valid: a number (m/s², along -z) or a vector [x, y, z]{shown}"
    if kind in ("extra_forbidden", "invalid_key", "missing"):
        parent, key = location[:-1], str(location[-1])
        model = _model_at(parent, data)
        valid = sorted(model.model_fields, key=lambda k: k in _ObjectText.model_fields)  # shape and sizes first
        if kind == "missing":
            needed = ", ".join(k for k in valid if model.model_fields[k].is_required())
            return f"{place}: missing key; needed: {_CAMERA_KEYS if model is _CameraText else needed}"
        owner = f" of a {data['objects'][parent[1]]['shape']}" if parent[:1] == ["objects"] else ""
        return f"{place}: unknown key{did_you_mean(key, valid)}; valid keys{owner}: {', '.join(valid)}"
    if kind == "absence_implicit":
        return first["msg"]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return f"{place}.shape: unknown or missing shape; valid: {', '.join(_SHAPE_MODELS)}"
    length = _LENGTHS.get(str(location[-1])) if location else None
    if length and kind in ("too_short", "too_long", "list_type"):
        return f"{place}: valid: a list of {length} numbers{shown}"
    if kind in _MESSAGES:
        keys = ", ".join(_model_at(location, data).model_fields) if kind == "model_type" else ""
        return f"{place}: {_MESSAGES[kind].format(**first.get('ctx', {}), keys=keys)}{shown}"
    return f"{place}: {first['msg']}"


_LENGTHS = {"position": 3, "velocity": 3, "angular_velocity": 3, "orientation": 4}


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _model_at(parent: list[Any], data: dict[str, Any]) -> type[BaseModel]:
    if parent[:1] == ["objects"]:
        return _SHAPE_MODELS[data["objects"][parent[1]]["shape"]]
    return _PLACES[".".join(map(str, parent))]


def number_text(value: float) -> str:
    """The shortest text that reads back as `value`."""
    text = repr(float(value))
    return text[:-2] if text.endswith(".0") and abs(value) >= 1e6 else text


def _vector_text(values: tuple[float, ...]) -> str:
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
    return "{" + ", ".join(parts) + "}"


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
    lines.append("objects:" if scene.objects else "objects: []")
    for o in scene.objects:
        lines.append(f"- name: {_name_text(o.name)}")
        lines.append(f"  shape: {o.shape}")
        if o.file is not None:
            lines.append(f"  file: {_quoted(o.file)}")
        lines += [f"  {key}: {number_text(v)}" for key, v in zip(SIZE_KEYS[o.shape], o.size, strict=True)]
        for key in OBJECT_KEYS:
            value = getattr(o, key)
            lines.append(f"  {key}: {_vector_text(value) if isinstance(value, tuple) else number_text(value)}")
    lines.append("effects:" if scene.effects else "effects: []")
    lines += [f"- {effect_text(e)}" for e in scene.effects]
    return "\n".join(lines) + "\n"
