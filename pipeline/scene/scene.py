"""The scene: camera, gravity, ground, objects and effects, as plain immutable values.

Every number is kept to six significant digits, the digits in which scenes are written, so that a scene that
is read back equals the one that was written.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

DIGITS = 6

#: Size keys of each shape, full lengths in m. `mesh` takes a file and a scale instead.
SIZE_KEYS: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "box": ("width", "depth", "height"),
    "capsule": ("radius", "height"),
    "ellipsoid": ("width", "depth", "height"),
    "mesh": ("scale",),
}
#: The paper's three shapes: what the sampler draws and what the model may answer.
BASIC_SHAPES = ("sphere", "cylinder", "box")


def canonical(value: float) -> float:
    """`value` to six significant digits; minus zero becomes zero."""
    return float(f"{float(value):.{DIGITS}g}") + 0.0


def canonical_vector(values: Any) -> tuple[float, ...]:
    return tuple(canonical(v) for v in values)


def unit_quaternion(values: Any) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z), first non-zero component positive, to six digits.

    A quaternion that is of unit length within those digits is left as it is, so that the rule is idempotent.
    """
    parts = [float(v) for v in values]
    largest = max(map(abs, parts))
    if largest == 0 or not all(map(math.isfinite, parts)):
        raise ValueError(f"no turn has the quaternion {parts}")
    if abs(math.hypot(*parts) - 1) >= 1e-5:
        parts = [v / largest for v in parts]  # first, lest squares of huge or tiny numbers leave the range of floats
        parts = [v / math.hypot(*parts) for v in parts]
    rounded = canonical_vector(parts)
    if next((v for v in rounded if v), 1.0) < 0:
        rounded = tuple(-v + 0.0 for v in rounded)
    return rounded  # type: ignore[return-value]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and the principal point in the middle.

    position: (3,) m. fov: vertical field of view, deg. pitch: deg, negative looks down, for a camera that looks
    along +y; or `orientation`, a unit quaternion of the camera's frame (x right, y up, looking along -z).
    """

    position: tuple[float, ...]
    fov: float
    pitch: float | None = None
    orientation: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", canonical_vector(self.position))
        object.__setattr__(self, "fov", canonical(self.fov))
        assert (self.pitch is None) != (self.orientation is None), "a camera has a pitch or an orientation"
        if self.pitch is not None:
            object.__setattr__(self, "pitch", canonical(self.pitch))
        if self.orientation is not None:
            object.__setattr__(self, "orientation", unit_quaternion(self.orientation))


@dataclass(frozen=True)
class SceneObject:
    """One rigid body. `size` follows `SIZE_KEYS[shape]`; the rest is in SI units in the world's frame."""

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
    file: str | None = None  # mesh only

    def __post_init__(self) -> None:
        assert len(self.size) == len(SIZE_KEYS[self.shape]), f"{self.shape} takes {SIZE_KEYS[self.shape]}"
        for key in ("mass", "sliding_friction", "rolling_friction", "damping"):
            object.__setattr__(self, key, canonical(getattr(self, key)))
        for key in ("size", "position", "velocity", "angular_velocity"):
            object.__setattr__(self, key, canonical_vector(getattr(self, key)))
        object.__setattr__(self, "orientation", unit_quaternion(self.orientation))


@dataclass(frozen=True)
class Effect:
    """A physical law added to the scene: its name, its parameters, and the objects it acts on (None: all)."""

    name: str
    parameters: tuple[tuple[str, Any], ...] = ()
    objects: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        values = ((k, canonical_vector(v) if isinstance(v, tuple) else canonical(v)) for k, v in self.parameters)
        object.__setattr__(self, "parameters", tuple(values))

    @property
    def values(self) -> dict[str, Any]:
        """The parameters by name: numbers, and tuples of numbers."""
        return dict(self.parameters)


@dataclass(frozen=True)
class Scene:
    """A whole scene. `gravity` is a vector, m/s²; `ground` is the plane's height, m, or None for no ground."""

    objects: tuple[SceneObject, ...]
    camera: Camera | None = None
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    ground: float | None = 0.0
    effects: tuple[Effect, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", canonical_vector(self.gravity))
        if self.ground is not None:
            object.__setattr__(self, "ground", canonical(self.ground))
        object.__setattr__(self, "objects", named(self.objects))

    @property
    def shapes(self) -> tuple[str, ...]:
        return tuple(o.shape for o in self.objects)

    @property
    def composition(self) -> str:
        """The multiset of shapes as a word: `box+sphere+sphere`."""
        return "+".join(sorted(self.shapes))


def named(objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """The objects with a name each: `shape_index` where none was given."""
    return tuple(o if o.name else replace(o, name=f"{o.shape}_{i}") for i, o in enumerate(objects))


def half_extents(obj: SceneObject) -> np.ndarray:
    """Half lengths along the body's own axes, (3,) m. For capsules the caps are included."""
    return half_from_size(obj.shape, np.array(obj.size))


def half_from_size(shape: str, size: np.ndarray) -> np.ndarray:
    """The same (..., 3) of one shape's sizes (..., S), m, in the order of SIZE_KEYS."""
    if shape == "sphere":
        return np.repeat(size, 3, axis=-1)
    if shape in ("cylinder", "capsule"):
        return np.stack([size[..., 0], size[..., 0], size[..., 1] / 2], axis=-1)
    if shape in ("box", "ellipsoid"):
        return size / 2
    raise ValueError(f"{shape} has no analytic extents")


def size_from_half(shape: str, half: np.ndarray) -> tuple[float, ...]:
    """The sizes of a body with such half extents (3,), m: what `half_from_size` undoes."""
    if shape == "sphere":
        return (float(half[0]),)
    if shape in ("cylinder", "capsule"):
        return (float(half[0]), 2 * float(half[2]))
    return tuple(2 * float(v) for v in half)
