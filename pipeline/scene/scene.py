"""The scene: camera, gravity, ground, objects and effects, as immutable values.

Every number is rounded to six significant digits, the precision of the scene text. So reading a written scene gives
an equal scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

SIGNIFICANT_DIGITS = 6

#: Size keys of each shape: full lengths in m. A mesh has a file and a scale instead.
SIZE_KEYS: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "box": ("width", "depth", "height"),
    "capsule": ("radius", "height"),
    "ellipsoid": ("width", "depth", "height"),
    "mesh": ("scale",),
}
#: The three shapes of the paper. The sampler draws them and the model may answer them.
BASIC_SHAPES = ("sphere", "cylinder", "box")


def rounded(value: float) -> float:
    """`value` rounded to six significant digits; minus zero becomes zero."""
    return float(f"{float(value):.{SIGNIFICANT_DIGITS}g}") + 0.0


def rounded_vector(values: Any) -> tuple[float, ...]:
    return tuple(rounded(v) for v in values)


def unit_quaternion(values: Any) -> tuple[float, float, float, float]:
    """The unit quaternion (w, x, y, z) in six digits, with its first non-zero component positive.

    A quaternion whose length is 1 to within 1e-5 is not normalised again, so that the function is idempotent.
    Raises ValueError where the quaternion is zero or not finite.
    """
    parts = [float(v) for v in values]
    largest = max(map(abs, parts))
    if largest == 0 or not all(map(math.isfinite, parts)):
        raise ValueError(f"a quaternion must be finite and non-zero, not {parts}")
    if abs(math.hypot(*parts) - 1) >= 1e-5:
        parts = [v / largest for v in parts]  # first, so that squares of huge or tiny numbers stay in the float range
        parts = [v / math.hypot(*parts) for v in parts]
    quaternion = rounded_vector(parts)
    if next((v for v in quaternion if v), 1.0) < 0:
        quaternion = tuple(-v + 0.0 for v in quaternion)
    return quaternion  # type: ignore[return-value]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and the principal point at the centre of the image.

    It has either a pitch or an orientation.

    Attributes:
        position: (3,) m.
        fov: Vertical field of view, deg.
        pitch: Angle of the optical axis above the horizontal, deg; the camera then looks along +y.
        orientation: Unit quaternion of the camera frame (x right, y up, looking along -z).
    """

    position: tuple[float, ...]
    fov: float
    pitch: float | None = None
    orientation: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", rounded_vector(self.position))
        object.__setattr__(self, "fov", rounded(self.fov))
        assert (self.pitch is None) != (self.orientation is None), "a camera has either a pitch or an orientation"
        if self.pitch is not None:
            object.__setattr__(self, "pitch", rounded(self.pitch))
        if self.orientation is not None:
            object.__setattr__(self, "orientation", unit_quaternion(self.orientation))


@dataclass(frozen=True)
class SceneObject:
    """One rigid body, in SI units and the world frame.

    Attributes:
        shape: A key of `SIZE_KEYS`.
        size: Full lengths in the order of `SIZE_KEYS[shape]`, m.
        mass: kg.
        sliding_friction: Coefficient.
        rolling_friction: m.
        damping: Damping ratio of its contacts.
        position: (3,) m.
        velocity: (3,) m/s.
        angular_velocity: (3,) rad/s.
        orientation: Unit quaternion (w, x, y, z), from the body frame to the world frame.
        name: Filled in by `Scene` where it is empty.
        file: Mesh file, for shape `mesh` only.
    """

    shape: str
    size: tuple[float, ...]
    mass: float
    sliding_friction: float = 0.5
    rolling_friction: float = 0.0
    damping: float = 1.0
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    angular_velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    orientation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    name: str = ""
    file: str | None = None

    def __post_init__(self) -> None:
        assert len(self.size) == len(SIZE_KEYS[self.shape]), f"{self.shape} takes {SIZE_KEYS[self.shape]}"
        for key in ("mass", "sliding_friction", "rolling_friction", "damping"):
            object.__setattr__(self, key, rounded(getattr(self, key)))
        for key in ("size", "position", "velocity", "angular_velocity"):
            object.__setattr__(self, key, rounded_vector(getattr(self, key)))
        object.__setattr__(self, "orientation", unit_quaternion(self.orientation))


@dataclass(frozen=True)
class Effect:
    """A physical law that is added to the scene: name, parameters, and the objects it acts on (None: all)."""

    name: str
    parameters: tuple[tuple[str, Any], ...] = ()
    objects: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        values = ((k, rounded_vector(v) if isinstance(v, tuple) else rounded(v)) for k, v in self.parameters)
        object.__setattr__(self, "parameters", tuple(values))

    @property
    def values(self) -> dict[str, Any]:
        """The parameters by name; each is a number or a tuple of numbers."""
        return dict(self.parameters)


@dataclass(frozen=True)
class Scene:
    """A whole scene.

    Attributes:
        objects: Rigid bodies; those without a name get one, `shape_index`.
        camera: None where there is none.
        gravity: (3,) m/s².
        ground: Height of the ground plane, m; None for no ground.
        effects: Physical laws beyond those of MuJoCo.
    """

    objects: tuple[SceneObject, ...]
    camera: Camera | None = None
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    ground: float | None = 0.0
    effects: tuple[Effect, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", rounded_vector(self.gravity))
        if self.ground is not None:
            object.__setattr__(self, "ground", rounded(self.ground))
        object.__setattr__(self, "objects", named(self.objects))

    @property
    def shapes(self) -> tuple[str, ...]:
        return tuple(o.shape for o in self.objects)

    @property
    def composition(self) -> str:
        """The sorted shapes, joined: `box+sphere+sphere`."""
        return "+".join(sorted(self.shapes))


def named(objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """The objects, each with a name: `shape_index` where none was given."""
    return tuple(o if o.name else replace(o, name=f"{o.shape}_{i}") for i, o in enumerate(objects))


def half_extents(obj: SceneObject) -> np.ndarray:
    """Half lengths along the axes of the body frame, (3,) m. Those of a capsule include its caps."""
    return half_from_size(obj.shape, np.array(obj.size))


def half_from_size(shape: str, size: np.ndarray) -> np.ndarray:
    """Half extents (..., 3) m from sizes (..., S) m of one shape, in the order of `SIZE_KEYS`."""
    if shape == "sphere":
        return np.repeat(size, 3, axis=-1)
    if shape in ("cylinder", "capsule"):
        return np.stack([size[..., 0], size[..., 0], size[..., 1] / 2], axis=-1)
    if shape in ("box", "ellipsoid"):
        return size / 2
    raise ValueError(f"{shape} has no analytic extents")


def size_from_half(shape: str, half: np.ndarray) -> tuple[float, ...]:
    """Sizes from half extents (3,), both in m; the inverse of `half_from_size`."""
    if shape == "sphere":
        return (float(half[0]),)
    if shape in ("cylinder", "capsule"):
        return (float(half[0]), 2 * float(half[2]))
    return tuple(2 * float(v) for v in half)
