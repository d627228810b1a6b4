"""Random candidate scenes as people film them: from the side, on inclines, in flight, from above, with fixed bodies.

`pipeline.clips.draw_views` decides which of them are accepted. Lengths and speeds are drawn in units of the height
that the camera sees at the distance of its target, so that a scene looks alike at every scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.canonical import canonical_object
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import Camera, FixedBody, Scene, SceneObject, half_extents
from pipeline.scene.solid import support

ASPECT = 1.5  # width over height of the picture
GAP = 1e-3  # m between a body and what it stands on, so that they do not overlap
X, Y, Z = np.eye(3)
_LYING = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])  # the axis of a cylinder, z, becomes -y


@dataclass(frozen=True)
class Surface:
    """A flat surface on which bodies are placed.

    Attributes:
        origin: (3,) m, a point on it.
        quaternion: (4,) rotation from its frame (x along, z normal) to the world.
    """

    origin: np.ndarray
    quaternion: np.ndarray

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) columns along, across, normal."""
        return matrix_from_quaternion(self.quaternion)


LEVEL = Surface(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def draw_view_scene(rng: np.random.Generator, kind: str) -> Scene:
    """One candidate scene of a kind of `VIEWS`. Gravity is Earth's and vertical."""
    seen = float(np.exp(rng.uniform(*np.log([0.6, 3.0]))))  # m, height of the view
    scene = VIEWS[kind](rng, seen)
    return replace(scene, objects=tuple(canonical_object(o) for o in scene.objects))


def _table(rng: np.random.Generator, seen: float) -> Scene:
    """A level ground from above and aside, with up to three objects and in some scenes a wall or a block."""
    camera = _camera(rng, seen, np.array([0, 0, 0.1 * seen]), pitch=(-50, -12), fov=(20, 60))
    objects = []
    for _ in range(rng.integers(1, 4)):
        place = rng.uniform(-0.45, 0.45, 2) * [ASPECT * seen, seen]
        heading = np.arctan2(*(rng.uniform(-0.2, 0.2, 2) * seen - place)[::-1])
        objects.append(_placed(rng, _body(rng, seen), LEVEL, place, rng.uniform(0.3, 1.2) * seen, heading))
    fixed = (_block(rng, seen, rng.uniform(-0.4, 0.4, 2) * [ASPECT * seen, seen]),) if rng.random() < 0.4 else ()
    return Scene(tuple(objects), camera, fixed=fixed)


def _side(rng: np.random.Generator, seen: float) -> Scene:
    """A level ground, or a table with an edge, from the side: bodies roll, slide, bounce and meet walls."""
    camera = _camera(rng, seen, np.array([0, 0, 0.3 * seen]), pitch=(-12, 2), fov=(8, 60))
    way = rng.choice([-1.0, 1.0])
    objects = []
    for _ in range(rng.integers(1, 3)):
        place = np.array([-way * rng.uniform(0.1, 0.6), rng.uniform(-0.15, 0.15)]) * seen
        heading = rng.normal(0, 0.1) + (0.0 if way > 0 else np.pi)
        obj = _placed(rng, _body(rng, seen), LEVEL, place, rng.uniform(0.4, 1.4) * seen, heading)
        if rng.random() < 0.3:  # it falls first
            up = np.add(obj.position, [0, 0, rng.uniform(0.1, 0.6) * seen])
            obj = replace(obj, position=tuple(up), damping=rng.uniform(0.05, 0.5))
        objects.append(obj)
    if rng.random() < 0.35:
        wall = _block(rng, seen, np.array([way * rng.uniform(0.3, 0.65) * seen, 0.0]), width=(0.04, 0.12))
        return Scene(tuple(objects), camera, fixed=(wall,))
    if rng.random() < 0.4:  # a table: beyond its edge bodies fall
        depth, height, edge = 0.8 * seen, rng.uniform(0.03, 0.1) * seen, rng.uniform(0.0, 0.4) * seen
        length = 2 * seen
        middle = (way * (edge - length / 2), 0.0, -height / 2)
        table = FixedBody("box", (length, depth, height), middle, name="table")
        below = -rng.uniform(0.2, 0.6) * seen if rng.random() < 0.5 else None
        return Scene(tuple(objects), camera, ground=below, fixed=(table,))
    return Scene(tuple(objects), camera)


def _incline(rng: np.random.Generator, seen: float) -> Scene:
    """A ramp from the side, of finite length above a level ground, or without an end."""
    way, angle = rng.choice([-1.0, 1.0]), np.radians(rng.uniform(8, 35))
    turn = quaternion_from_rotation_vector(way * angle * Y)
    middle = np.array([0, 0, 0.5 * seen])
    camera = _camera(rng, seen, middle, pitch=(-15, 2), fov=(8, 60))
    surface = Surface(middle, turn)
    normal = surface.axes[:, 2]
    if rng.random() < 0.6:
        length, depth, height = (
            np.array([rng.uniform(0.8, 1.4), rng.uniform(0.25, 0.6), rng.uniform(0.03, 0.08)]) * seen
        )
        box = FixedBody("box", (length, depth, height), tuple(middle - height / 2 * normal), tuple(turn), name="ramp")
        lowest = middle[2] - (length / 2 * np.sin(angle) + height * np.cos(angle))
        fixed, ground = box, lowest - rng.uniform(0.0, 0.2) * seen
    else:
        fixed, ground = FixedBody("plane", (), tuple(middle), tuple(turn), name="ramp"), None
        length = ASPECT * seen
    if rng.random() < 0.3:
        fixed = replace(fixed, sliding_friction=rng.uniform(0.0, 1.0))
    objects = []
    for _ in range(1 if rng.random() < 0.8 else 2):
        place = np.array([-way * rng.uniform(0.05, 0.42) * length, rng.uniform(-0.08, 0.08) * seen])
        upward = rng.random() < 0.15
        heading = 0.0 if (way > 0) != upward else np.pi
        speed = rng.uniform(0.5, 1.2) * seen if upward else max(0.0, rng.uniform(-0.4, 0.4)) * seen
        obj = _placed(rng, _body(rng, 0.8 * seen), surface, -place if upward else place, speed, heading)
        rolls = obj.shape == "sphere" or any(obj.angular_velocity) or obj.sliding_friction > 0.5
        friction = rng.uniform(0.4, 1.2) if rolls else rng.uniform(0.0, 0.9) * np.tan(angle)
        objects.append(replace(obj, sliding_friction=friction))
    return Scene(tuple(objects), camera, ground=ground, fixed=(fixed,))


def _flight(rng: np.random.Generator, seen: float) -> Scene:
    """Throws and falls without a ground in view, in some scenes before a wall."""
    camera = _camera(rng, seen, np.zeros(3), pitch=(-10, 10), fov=(15, 60))
    objects = []
    for _ in range(1 if rng.random() < 0.75 else 2):
        way = rng.choice([-1.0, 1.0])
        rise = rng.uniform(0.0, 0.8) * seen  # from the start to the apex
        start = np.array([-way * rng.uniform(0.1, 0.65), rng.uniform(-0.15, 0.15), -0.4]) * seen
        start[2] += max(0.0, 0.8 * seen - rise) * rng.random()
        obj = _body(rng, seen)
        turn = rng.normal(size=4)
        velocity = np.array([way * rng.uniform(0.1, 1.4) * seen, rng.normal(0, 0.1) * seen, np.sqrt(2 * 9.81 * rise)])
        spin = rng.normal(size=3) * rng.uniform(0, 6)
        objects.append(
            replace(
                obj,
                position=tuple(start),
                velocity=tuple(velocity),
                angular_velocity=tuple(spin),
                orientation=tuple(turn / np.linalg.norm(turn)),
            )
        )
    fixed: tuple[FixedBody, ...] = ()
    if rng.random() < 0.3:
        facing = quaternion_from_rotation_vector(np.pi / 2 * X)  # the normal is -y, towards the camera
        fixed = (FixedBody("plane", (), (0, rng.uniform(0.5, 1.5) * seen, 0), tuple(facing), name="wall"),)
    return Scene(tuple(objects), camera, ground=None, fixed=fixed)


def _top(rng: np.random.Generator, seen: float) -> Scene:
    """A level ground from straight above: pucks slide, balls roll, and they collide."""
    camera = _camera(rng, seen, np.zeros(3), pitch=(-90, -86), fov=(20, 60), roll=(-180, 180))
    objects = []
    for _ in range(rng.integers(1, 4)):
        angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(0.1, 0.45) * seen
        place = distance * np.array([np.cos(angle), np.sin(angle)])
        heading = angle + np.pi + rng.normal(0, 0.3)
        obj = _placed(rng, _body(rng, seen), LEVEL, place, rng.uniform(0.3, 1.0) * seen, heading)
        if obj.shape != "sphere":
            obj = replace(obj, sliding_friction=rng.choice([rng.uniform(0.0, 0.01), rng.uniform(0.01, 0.1)]))
        objects.append(obj)
    fixed = (_block(rng, seen, rng.choice([-1, 1], 2) * rng.uniform(0.3, 0.5, 2) * seen),) if rng.random() < 0.3 else ()
    return Scene(tuple(objects), camera, fixed=fixed)


#: The kinds of views, each with what draws it.
VIEWS: dict[str, Callable[[np.random.Generator, float], Scene]] = {
    "table": _table,
    "side": _side,
    "incline": _incline,
    "flight": _flight,
    "top": _top,
}


def _camera(
    rng: np.random.Generator,
    seen: float,
    target: np.ndarray,
    *,
    pitch: tuple[float, float],
    fov: tuple[float, float],
    roll: tuple[float, float] = (-4.0, 4.0),
) -> Camera:
    """A camera about 90° from the x axis.

    Args:
        rng: Random generator.
        seen: Height of the view at the target, m.
        target: (3,) m.
        pitch: Range, deg.
        fov: Range, deg, log-uniform.
        roll: Range, deg.
    """
    field = float(np.exp(rng.uniform(*np.log(fov))))
    tilt, yaw, turn = np.radians([90 + rng.uniform(*pitch), rng.normal(0, 8), rng.uniform(*roll)])
    orientation = np.array([1.0, 0.0, 0.0, 0.0])
    for angle, axis in ((yaw, Z), (tilt, X), (turn, Z)):
        orientation = quaternion_multiply(orientation, quaternion_from_rotation_vector(angle * axis))
    distance = seen / 2 / np.tan(np.radians(field) / 2)
    back = matrix_from_quaternion(orientation)[:, 2]
    return Camera(tuple(target + distance * back), field, orientation=tuple(orientation))


def _body(rng: np.random.Generator, seen: float) -> SceneObject:
    """A body of random shape, size and material; some balls and cylinders are hollow."""
    shape = str(rng.choice(["sphere", "cylinder", "box"], p=[0.45, 0.25, 0.3]))
    radius = rng.uniform(0.05, 0.12) * seen
    size: tuple[float, ...] = (radius,)
    if shape == "cylinder":
        size = (radius, radius * rng.uniform(0.4, 3.0))
    elif shape == "box":
        size = tuple(rng.uniform(0.09, 0.22, 3) * seen)
    hollow = shape != "box" and rng.random() < 0.3
    return SceneObject(
        shape,
        size,
        mass=float(np.exp(rng.uniform(*np.log([0.05, 2.0])))),
        sliding_friction=rng.uniform(0.05, 0.8),
        rolling_friction=rng.uniform(0.0, 0.01) * radius,
        damping=rng.uniform(0.2, 1.0),
        hollow=rng.uniform(0.5, 1.0) if hollow else 0.0,
    )


def _placed(
    rng: np.random.Generator,
    obj: SceneObject,
    surface: Surface,
    place: np.ndarray,
    speed: float,
    heading: float,
) -> SceneObject:
    """A body on a surface that rolls where it can, and else slides.

    Args:
        rng: Random generator.
        obj: Its shape, size and material.
        surface: What it stands on.
        place: (2,) along and across the surface, m from its origin.
        speed: m/s.
        heading: Direction of the motion in the surface, rad from its x axis.
    """
    axes = surface.axes
    normal = axes[:, 2]
    rolls = obj.shape == "sphere" or (obj.shape == "cylinder" and rng.random() < 0.6)
    yaw = heading if rolls else heading + rng.normal(0, 0.3)
    turn = quaternion_multiply(surface.quaternion, quaternion_from_rotation_vector(yaw * Z))
    if obj.shape == "cylinder" and rolls:
        turn = quaternion_multiply(turn, _LYING)
    down = matrix_from_quaternion(turn).T @ -normal
    reach = support(obj.shape, half_extents(obj)[None], down[None])[0] + GAP
    position = surface.origin + axes[:, :2] @ place + reach * normal
    velocity = speed * (axes[:, 0] * np.cos(heading) + axes[:, 1] * np.sin(heading))
    spin = np.cross(normal, velocity) / obj.size[0] if rolls else np.zeros(3)
    return replace(
        obj,
        position=tuple(position),
        velocity=tuple(velocity),
        angular_velocity=tuple(spin),
        orientation=tuple(turn),
    )


def _block(
    rng: np.random.Generator, seen: float, place: np.ndarray, width: tuple[float, float] = (0.06, 0.3)
) -> FixedBody:
    """A fixed box on the level ground; place: (2,) m; width: range in units of the height of the view."""
    size = np.array([rng.uniform(*width), rng.uniform(0.2, 0.6), rng.uniform(0.1, 0.4)]) * seen
    yaw = quaternion_from_rotation_vector(rng.normal(0, 0.15) * Z)
    damping = rng.uniform(0.1, 0.8) if rng.random() < 0.5 else None
    return FixedBody("box", tuple(size), (*place, size[2] / 2), tuple(yaw), damping=damping, name="block")
