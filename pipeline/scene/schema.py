"""The keys and values that the text of a scene may have, as pydantic models (described in docs/formats.md).

Everything else that concerns the text is in `pipeline.scene.text`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from pipeline.scene.scene import FIXED_SIZE_KEYS, JOINT_KEYS, SIZE_KEYS

MOST = 1e7  # of any number, in its unit: larger ones are mistakes, and overflow in the simulation
MOST_BODIES, MOST_EFFECTS = 500, 100
Number = Annotated[float, Field(allow_inf_nan=False, strict=True, ge=-MOST, le=MOST)]
Positive = Annotated[float, Field(allow_inf_nan=False, strict=True, gt=0, le=MOST)]
NonNegative = Annotated[float, Field(allow_inf_nan=False, strict=True, ge=0, le=MOST)]
Ratio = Annotated[float, Field(allow_inf_nan=False, strict=True, ge=0, le=1)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Quaternion = Annotated[
    list[Annotated[float, Field(allow_inf_nan=False, strict=True)]], Field(min_length=4, max_length=4)
]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


def _nonzero_quaternion(value: list[float] | None) -> list[float] | None:
    if value is not None and math.hypot(*value) == 0:
        raise PydanticCustomError("quaternion", "a quaternion must be non-zero; valid: w, x, y, z that are not all 0")
    return value


class CameraText(_Strict):
    position: Vector
    pitch: Annotated[float, Field(allow_inf_nan=False, strict=True, ge=-90, le=90)] | None = None
    orientation: Quaternion | None = None
    fov: Annotated[float, Field(allow_inf_nan=False, strict=True, gt=0, lt=180)]

    _check = field_validator("orientation")(_nonzero_quaternion)

    @model_validator(mode="after")
    def _one_direction(self) -> CameraText:
        if (self.pitch is None) == (self.orientation is None):
            raise PydanticCustomError("direction", "give either pitch (deg) or orientation (quaternion w, x, y, z)")
        return self


class GroundText(_Strict):
    height: Number


class SpringText(_Strict):
    stiffness: Positive
    rest: Number = 0.0


Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100)]


class JointText(_Strict):
    kind: Literal["hinge", "slide", "ball", "rod", "rope"]
    anchor: Vector
    axis: Vector | None = None
    end: Vector | None = None
    length: Positive | None = None
    spring: SpringText | None = None
    damping: NonNegative = 0.0
    friction: NonNegative = 0.0
    to: Name | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> JointText:
        valid = JOINT_KEYS[self.kind]
        own = self.model_fields_set - {"kind", "anchor", "to"}
        message = None
        if "axis" in valid and (self.axis is None or math.hypot(*self.axis) == 0):
            message = f"a {self.kind} needs an axis; valid: a vector that is not 0"
        elif wrong := sorted(own - set(valid)):
            message = f"a {self.kind} has no {wrong[0]}; valid keys: kind, anchor, {', '.join(valid)}, to"
        elif self.length is not None and self.spring is not None:
            message = "a rope with a spring has no length; valid: the spring's rest"
        if message:
            raise PydanticCustomError("joint", "{message}", {"message": message})
        return self


class ObjectText(_Strict):
    name: Name | None = None
    mass: Positive
    sliding_friction: NonNegative
    rolling_friction: NonNegative
    damping: Positive  # MuJoCo divides by it
    position: Vector
    velocity: Vector
    angular_velocity: Vector
    orientation: Quaternion
    joint: JointText | None = None

    _check = field_validator("orientation")(_nonzero_quaternion)


class FixedText(_Strict):
    name: Name | None = None
    position: Vector
    orientation: Quaternion = [1.0, 0.0, 0.0, 0.0]
    sliding_friction: NonNegative | None = None
    rolling_friction: NonNegative | None = None
    damping: Positive | None = None

    _check = field_validator("orientation")(_nonzero_quaternion)


class _SphereShape(_Strict):
    shape: Literal["sphere"]
    radius: Positive


class _CylinderShape(_Strict):
    shape: Literal["cylinder"]
    radius: Positive
    height: Positive


class _BoxShape(_Strict):
    shape: Literal["box"]
    width: Positive
    depth: Positive
    height: Positive


class _CapsuleShape(_Strict):
    shape: Literal["capsule"]
    radius: Positive
    height: Positive

    @model_validator(mode="after")
    def _caps_fit(self) -> _CapsuleShape:
        if self.height <= 2 * self.radius:
            raise PydanticCustomError("capsule", "height includes both caps; valid: more than twice the radius")
        return self


class _EllipsoidShape(_Strict):
    shape: Literal["ellipsoid"]
    width: Positive
    depth: Positive
    height: Positive


class _MeshShape(_Strict):
    shape: Literal["mesh"]
    file: str
    scale: Positive


class _PlaneShape(_Strict):
    shape: Literal["plane"]


class _Sphere(ObjectText, _SphereShape):
    hollow: Ratio = 0.0


class _Cylinder(ObjectText, _CylinderShape):
    hollow: Ratio = 0.0


class _Box(ObjectText, _BoxShape): ...


class _Capsule(ObjectText, _CapsuleShape): ...


class _Ellipsoid(ObjectText, _EllipsoidShape): ...


class _Mesh(ObjectText, _MeshShape): ...


class _FixedSphere(FixedText, _SphereShape): ...


class _FixedCylinder(FixedText, _CylinderShape): ...


class _FixedBox(FixedText, _BoxShape): ...


class _FixedCapsule(FixedText, _CapsuleShape): ...


class _FixedEllipsoid(FixedText, _EllipsoidShape): ...


class _FixedMesh(FixedText, _MeshShape): ...


class _FixedPlane(FixedText, _PlaneShape): ...


_ObjectOfAnyShape = Annotated[_Sphere | _Cylinder | _Box | _Capsule | _Ellipsoid | _Mesh, Field(discriminator="shape")]
_FixedOfAnyShape = Annotated[
    _FixedSphere | _FixedCylinder | _FixedBox | _FixedCapsule | _FixedEllipsoid | _FixedMesh | _FixedPlane,
    Field(discriminator="shape"),
]


class SceneText(_Strict):
    camera: CameraText | None = None
    gravity: Number | Vector
    ground: GroundText | None = None
    fixed: Annotated[list[_FixedOfAnyShape], Field(max_length=MOST_BODIES)] = []
    objects: Annotated[list[_ObjectOfAnyShape], Field(max_length=MOST_BODIES)]
    effects: Annotated[list[Any], Field(max_length=MOST_EFFECTS)] = []  # read by pipeline.scene.effects.text

    @model_validator(mode="before")
    @classmethod
    def _absence_is_explicit(cls, data: Any) -> Any:
        for key, form in (("camera", "{position, pitch, fov}"), ("ground", "{height: 0.0}")):
            if isinstance(data, dict) and key not in data and data.keys() <= cls.model_fields.keys():
                message = f"{key}: missing key; valid: {form}, or null for none"
                raise PydanticCustomError("absence_implicit", "{message}", {"message": message})
        return data


def _by_shape(union: Any) -> dict[str, type[BaseModel]]:
    """The members of an annotated union of models, by their shape."""
    return {m.model_fields["shape"].annotation.__args__[0]: m for m in union.__origin__.__args__}


#: The models of each list of bodies, by shape.
SHAPE_MODELS = {"objects": _by_shape(_ObjectOfAnyShape), "fixed": _by_shape(_FixedOfAnyShape)}
assert SHAPE_MODELS["objects"].keys() == SIZE_KEYS.keys()
assert SHAPE_MODELS["fixed"].keys() == FIXED_SIZE_KEYS.keys()
#: The models of the other mappings, by their place in the scene or in a body.
PLACES: dict[str, type[BaseModel]] = {
    "": SceneText,
    "camera": CameraText,
    "ground": GroundText,
    "joint": JointText,
    "joint.spring": SpringText,
}
