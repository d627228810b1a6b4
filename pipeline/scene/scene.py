"""The scene: camera, gravity, ground, fixed bodies, objects and effects, as immutable values.

Every number is rounded to six significant digits, the precision of the scene text. So reading a written scene gives
an equal scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.scene.effects.region import Region

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
#: Size keys of the bodies that do not move: the shapes of objects, and an unbounded plane.
FIXED_SIZE_KEYS: dict[str, tuple[str, ...]] = {**SIZE_KEYS, "plane": ()}
#: Shapes of objects that may be hollow.
HOLLOW_SHAPES = ("sphere", "cylinder")
#: The numbers of a contact.
CONTACT_KEYS = ("sliding_friction", "rolling_friction", "damping")
#: Keys of each kind of joint beside `kind`, `anchor` and `to`. Lengths and forces of a rope are along it.
JOINT_KEYS: dict[str, tuple[str, ...]] = {
    "hinge": ("axis", "spring", "damping", "friction"),
    "slide": ("axis", "spring", "damping", "friction"),
    "ball": ("damping", "friction"),
    "rod": ("end", "damping", "friction"),
    "rope": ("end", "length", "spring", "damping", "friction"),
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
class Spring:
    """A linear spring.

    Attributes:
        stiffness: N/m, or N m/rad of a hinge.
        rest: Where it is at rest: of a slide the place of the body's centre along the axis, m from the anchor; of a
            hinge the angle from the initial state, rad; of a rope its length, m, below which it is slack.
    """

    stiffness: float
    rest: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", rounded(self.stiffness))
        object.__setattr__(self, "rest", rounded(self.rest))


@dataclass(frozen=True)
class Joint:
    """What holds or guides a body. Vectors are in the world frame, in the initial state.

    A rod is fixed to the body and turns freely about its anchor, as a ball joint does. A rope pulls only.

    Attributes:
        kind: A key of `JOINT_KEYS`.
        anchor: (3,) m.
        axis: (3,) of a hinge or slide, of any length; a hinge's goes through the anchor.
        end: (3,) m, where a rope or rod ends on the body; None for its centre.
        length: Of a rope, m; None for its length in the initial state. A rope with a spring has none.
        spring: Of a hinge, slide or rope.
        damping: N m s/rad, or N s/m of a slide or rope.
        friction: Coulomb friction, N m, or N of a slide or rope.
        to: Name of the object to which it is fixed; None for the world.
    """

    kind: str
    anchor: tuple[float, ...]
    axis: tuple[float, ...] | None = None
    end: tuple[float, ...] | None = None
    length: float | None = None
    spring: Spring | None = None
    damping: float = 0.0
    friction: float = 0.0
    to: str | None = None

    def __post_init__(self) -> None:
        for key in ("anchor", "axis", "end"):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, rounded_vector(getattr(self, key)))
        for key in ("length", "damping", "friction"):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, rounded(getattr(self, key)))


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
        hollow: Inner over outer radius, 0 to 1, of a spherical shell or of a pipe with open ends; 0 for a solid.
        joint: What holds or guides it; None for a free body.
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
    hollow: float = 0.0
    joint: Joint | None = None

    def __post_init__(self) -> None:
        assert len(self.size) == len(SIZE_KEYS[self.shape]), f"{self.shape} takes {SIZE_KEYS[self.shape]}"
        assert self.hollow == 0 or (self.shape in HOLLOW_SHAPES and 0 < self.hollow <= 1), "only spheres and pipes"
        for key in ("mass", "sliding_friction", "rolling_friction", "damping", "hollow"):
            object.__setattr__(self, key, rounded(getattr(self, key)))
        for key in ("size", "position", "velocity", "angular_velocity"):
            object.__setattr__(self, key, rounded_vector(getattr(self, key)))
        object.__setattr__(self, "orientation", unit_quaternion(self.orientation))


@dataclass(frozen=True)
class FixedBody:
    """A body that does not move: a ramp, a wall, the edge of a table. In SI units and the world frame.

    Its contacts have its own numbers where it has them, else those of the object that it touches.

    Attributes:
        shape: A key of `FIXED_SIZE_KEYS`.
        size: Full lengths in the order of `FIXED_SIZE_KEYS[shape]`, m; a plane has none.
        position: (3,) m; of a plane, any point on it.
        orientation: Unit quaternion (w, x, y, z), from the body frame to the world frame; a plane's normal is its z.
        sliding_friction: Coefficient; None for that of the object.
        rolling_friction: m; None for that of the object.
        damping: Damping ratio of its contacts; None for that of the object.
        name: Filled in by `Scene` where it is empty.
        file: Mesh file, for shape `mesh` only.
    """

    shape: str
    size: tuple[float, ...] = ()
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    orientation: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    sliding_friction: float | None = None
    rolling_friction: float | None = None
    damping: float | None = None
    name: str = ""
    file: str | None = None

    def __post_init__(self) -> None:
        keys = FIXED_SIZE_KEYS[self.shape]
        assert len(self.size) == len(keys), f"{self.shape} takes {keys}"
        for key in CONTACT_KEYS:
            if getattr(self, key) is not None:
                object.__setattr__(self, key, rounded(getattr(self, key)))
        for key in ("size", "position"):
            object.__setattr__(self, key, rounded_vector(getattr(self, key)))
        object.__setattr__(self, "orientation", unit_quaternion(self.orientation))

    @property
    def has_contact_numbers(self) -> bool:
        """Whether it has any contact number of its own."""
        return any(getattr(self, key) is not None for key in CONTACT_KEYS)


@dataclass(frozen=True)
class Effect:
    """A physical law that is added to the scene.

    Attributes:
        name: Of its kind.
        parameters: Names and values.
        objects: On which it acts; None: all.
        only: Where it acts; None: everywhere.
    """

    name: str
    parameters: tuple[tuple[str, Any], ...] = ()
    objects: tuple[str, ...] | None = None
    only: Region | None = None

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
        fixed: Bodies that do not move, beside the ground; those without a name get one, `fixed_index`.
    """

    objects: tuple[SceneObject, ...]
    camera: Camera | None = None
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)
    ground: float | None = 0.0
    effects: tuple[Effect, ...] = field(default=())
    fixed: tuple[FixedBody, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", rounded_vector(self.gravity))
        if self.ground is not None:
            object.__setattr__(self, "ground", rounded(self.ground))
        object.__setattr__(self, "objects", named(self.objects))
        fixed = (b if b.name else replace(b, name=f"fixed_{i}") for i, b in enumerate(self.fixed))
        object.__setattr__(self, "fixed", tuple(fixed))

    @property
    def shapes(self) -> tuple[str, ...]:
        return tuple(o.shape for o in self.objects)

    @property
    def jointed(self) -> bool:
        """Whether any object has a joint."""
        return any(o.joint is not None for o in self.objects)

    def without_joints(self) -> Scene:
        """The scene with all objects free."""
        return replace(self, objects=tuple(replace(o, joint=None) for o in self.objects)) if self.jointed else self

    @property
    def composition(self) -> str:
        """The sorted shapes, joined: `box+sphere+sphere`."""
        return "+".join(sorted(self.shapes))


def named(objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
    """The objects, each with a name: `shape_index` where none was given."""
    return tuple(o if o.name else replace(o, name=f"{o.shape}_{i}") for i, o in enumerate(objects))


def half_extents(obj: SceneObject | FixedBody) -> np.ndarray:
    """Half lengths along the axes of the body frame, (3,) m; those of a capsule include its caps, a plane's are 0."""
    return half_from_size(obj.shape, np.array(obj.size))


def half_from_size(shape: str, size: np.ndarray) -> np.ndarray:
    """Half extents (..., 3) m from sizes (..., S) m of one shape, in the order of `SIZE_KEYS`."""
    if shape == "sphere":
        return np.repeat(size, 3, axis=-1)
    if shape in ("cylinder", "capsule"):
        return np.stack([size[..., 0], size[..., 0], size[..., 1] / 2], axis=-1)
    if shape in ("box", "ellipsoid"):
        return size / 2
    if shape == "plane":
        return np.zeros((*size.shape[:-1], 3))
    raise ValueError(f"{shape} has no analytic extents")


def size_from_half(shape: str, half: np.ndarray) -> tuple[float, ...]:
    """Sizes from half extents (3,), both in m; the inverse of `half_from_size`."""
    if shape == "sphere":
        return (float(half[0]),)
    if shape in ("cylinder", "capsule"):
        return (float(half[0]), 2 * float(half[2]))
    return tuple(2 * float(v) for v in half)
