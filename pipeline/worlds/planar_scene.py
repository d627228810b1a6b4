"""A scene in which bodies move in a plane parallel to the picture, as their tracks tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.scene.scene import FixedBody, Scene, SceneObject
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.worlds.arcs import Arc, design
from pipeline.worlds.blocks import BACK, DAMPING, DEPTH, FRONT, HEIGHT, Block, block_body
from pipeline.worlds.bounces import changes_between
from pipeline.worlds.collisions import find_collisions
from pipeline.worlds.plane import Plane
from pipeline.worlds.scale import ROLLING
from pipeline.worlds.silhouette import Silhouette
from pipeline.worlds.supports import Support
from pipeline.worlds.tumbling import Tumbling
from pipeline.worlds.view import View

FRICTION = 0.4  # of bodies whose tracks tell nothing of it
LEAST_FRICTION, MOST_FRICTION = 0.001, 1.0
LEAST_BRAKED = 6  # frames of an arc whose deceleration is measured
BOX_DEPTH = 0.5  # of a box, which cannot be seen, over its shorter side that can
THICKNESS, STEPS_INSIDE = 2.0, 8.0  # least thickness of supports: radii of the largest body, and steps at full speed
NARROW = 0.5  # instead of FRONT, where the near side of a support would hide what stands on it
CYLINDER_LENGTH = 0.5  # of a cylinder that is seen along its axis, in radii: what cannot be seen
SPRING = 2.36  # -log of the restitution over the damping ratio, of bodies of 10 cm that fall 50 cm (simulated)
#: Of what is round in all frames: a cylinder in flight is seldom seen along its axis for long, a top view is of pucks.
ROUND_SHAPES = {"flight": "sphere", "top": "cylinder", "hanging": "sphere"}
#: Rolling friction over a ball's radius, as a share of its deceleration over gravity: the ball's inertia rolls, too.
ROLLING_SHARE = 1 / ROLLING["sphere"]
PUCK_HEIGHT = 0.6  # of a disc seen from above, in radii


def planar_scene(
    view: View,
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    silhouettes: Sequence[Silhouette],
    supports: Sequence[Support],
    solids: Sequence[Tumbling | None],
    blocks: Sequence[Block] = (),
    *,
    plane: Plane,
    gravity: float,
) -> Scene:
    """The scene at time 0 in which each body goes on as its first arc.

    Args:
        view: Of the clip: not a table.
        tracks: Of its bodies.
        arcs: Of each track, at least one.
        silhouettes: Of each body.
        supports: What carries bodies, or what they bounce off.
        solids: Of each body that turns freely in the air, its shape, orientation and spin at time 0; None of others.
        blocks: Fixed bodies that a user pointed at.
        plane: In which they move.
        gravity: m/s².
    """
    largest = max(s.width for s in silhouettes) / 2 / plane.px_per_m
    objects = [
        planar_object(view, track, own, outline, plane=plane, gravity=gravity, carried=bool(supports))
        for track, own, outline in zip(tracks, arcs, silhouettes, strict=True)
    ]
    objects = [o if s is None else _as_solid(o, s, plane) for o, s in zip(objects, solids, strict=True)]
    collisions = find_collisions(tracks, arcs)
    bounces = [c.restitution for c in collisions]
    for hit in collisions[:1]:
        objects[hit.second] = replace(objects[hit.second], mass=objects[hit.first].mass * hit.mass_ratio)
    if bounces:
        objects = [replace(o, damping=damping_of(float(np.median(bounces)))) for o in objects]
    fastest = max(_fastest(a) for own in arcs for a in own) / plane.px_per_m
    top = max(2 * o.position[2] for o in objects) if plane.level else 0.0
    fixed = tuple(
        wall_body(s, plane, top, f"support_{i}")
        if plane.level
        else support_body(s, plane, largest, fastest, f"support_{i}")
        for i, s in enumerate(supports)
    )
    fixed += tuple(block_body(b, plane, radius=largest, top=top, name=f"block_{i}") for i, b in enumerate(blocks))
    camera = plane.camera()
    if plane.level:
        x, y, z = camera.position
        camera = replace(camera, position=(x, y, z + top))
        return Scene(tuple(objects), camera, (0.0, 0.0, -gravity), ground=0.0, fixed=fixed)
    return Scene(tuple(objects), camera, (0.0, 0.0, -gravity), ground=None, fixed=fixed)


def planar_object(
    view: View,
    track: ImageTrack,
    arcs: Sequence[Arc],
    outline: Silhouette,
    *,
    plane: Plane,
    gravity: float,
    carried: bool,
) -> SceneObject:
    """One body at time 0; see `planar_scene`. carried: there are supports, on which a disc rolls."""
    first = arcs[0]
    kind = next(m.kind for m in view.arcs if m.arc is first)
    place_px, velocity_px = initial_motion(view, track, arcs)
    position, velocity = plane.to_world(place_px), plane.directions(velocity_px)
    half = 0.5 * np.array([outline.width, outline.height]) / plane.px_per_m
    shape = outline.shape
    if outline.round and view.kind in ROUND_SHAPES:
        shape = ROUND_SHAPES[view.kind]
    off, spin = 0.0, np.zeros(3)
    orientation = np.array([1.0, 0.0, 0.0, 0.0])
    if shape == "sphere":
        size: tuple[float, ...] = (float(half[0]),)
    elif shape == "cylinder" and plane.level:
        size = (float(half[0]), PUCK_HEIGHT * float(half[0]))
        off = size[1] / 2
    elif shape == "cylinder":  # seen along its axis
        size = (float(half[0]), CYLINDER_LENGTH * float(half[0]))
        orientation = Rotation.from_euler("x", -90, degrees=True).as_quat(scalar_first=True)
    else:
        depth = BOX_DEPTH * 2 * float(half.min())
        angle = float(track.angle[0]) - plane.roll
        if plane.level:
            size = (2 * float(half[0]), 2 * float(half[1]), depth)
            orientation = Rotation.from_euler("z", -angle).as_quat(scalar_first=True)
            off = depth / 2
        else:
            size = (2 * float(half[0]), depth, 2 * float(half[1]))
            orientation = Rotation.from_euler("y", angle).as_quat(scalar_first=True)
    friction, resistance = FRICTION, 0.0
    if plane.level and shape == "sphere":
        off = float(half[0])
        spin = np.cross([0.0, 0.0, 1.0], plane.in_space(velocity)) / half[0]
        resistance = ROLLING_SHARE * half[0] * _braking(track, longest_moving(view, track, arcs), plane, gravity)
    elif plane.level:
        friction = _braking(track, longest_moving(view, track, arcs), plane, gravity)
    elif carried and shape != "box" and kind != "free":
        spin = np.array([0.0, float(np.sign(velocity[0]) * np.linalg.norm(velocity) / half[0]), 0.0])
    elif carried and shape == "box" and kind in ("slope", "straight"):
        friction = sliding_friction(first, view.slope_deg, plane, gravity)
    return SceneObject(
        shape,
        size,
        1.0,
        sliding_friction=friction,
        rolling_friction=resistance,
        damping=DAMPING,
        position=tuple(plane.in_space(position, off)),
        velocity=tuple(plane.in_space(velocity)),
        angular_velocity=tuple(spin),
        orientation=tuple(orientation),
    )


def initial_motion(view: View, track: ImageTrack, arcs: Sequence[Arc]) -> tuple[np.ndarray, np.ndarray]:
    """Place (2,) px and velocity (2,) px/s of a body at time 0.

    All samples count up to the first jump of the velocity. A body that falls does so with the gravity of the clip.
    """
    kinds = [m.kind for m in view.arcs if m.arc.body == track.body]
    if kinds[0] == "rest":
        return arcs[0].position, np.zeros(2)
    free, last = kinds[0] == "free", 0
    while (
        last + 1 < len(arcs)
        and (kinds[last + 1] == "free") == free
        and not changes_between(track, arcs[last], arcs[last + 1])
    ):
        last += 1
    use = np.arange(arcs[0].start, arcs[last].stop)
    use = use[track.whole[use]]
    time, centre = track.times[use], track.centre[use]
    matrix = design(time)
    if free and view.gravity_px is not None:
        centre, matrix = centre - 0.5 * time[:, None] ** 2 * view.gravity_px, matrix[:, :2]
    elif all(not a.acceleration.any() for a in arcs[: last + 1]):
        matrix = matrix[:, :2]
    found = np.linalg.lstsq(matrix, centre, rcond=None)[0]
    return found[0], found[1]


def _as_solid(body: SceneObject, solid: Tumbling, plane: Plane) -> SceneObject:
    return replace(
        body,
        shape=solid.shape,
        size=tuple(s / plane.px_per_m for s in solid.size),
        orientation=tuple(solid.orientation),
        angular_velocity=tuple(solid.spin),
    )


def longest_moving(view: View, track: ImageTrack, arcs: Sequence[Arc]) -> Arc:
    """The longest arc in which a body moves; the first where it rests in all."""
    kinds = [m.kind for m in view.arcs if m.arc.body == track.body]
    moving = [a for a, k in zip(arcs, kinds, strict=True) if k != "rest"] or [arcs[0]]
    return max(moving, key=lambda a: a.span)


def wall_body(support: Support, plane: Plane, height: float, name: str) -> FixedBody:
    """The fixed box on level ground one of whose upright sides is a support. height: m, of the tallest body."""
    a, b = plane.to_world(support.start), plane.to_world(support.stop)
    along, into = b - a, plane.directions(support.into)
    depth = DEPTH * float(np.linalg.norm(along))
    middle = 0.5 * (a + b) + 0.5 * depth * into / np.linalg.norm(into)
    turn = Rotation.from_euler("z", np.arctan2(along[1], along[0])).as_quat(scalar_first=True)
    size = (float(np.linalg.norm(along)), depth, HEIGHT * height)
    damping = None if support.restitution is None else damping_of(support.restitution)
    position = (*middle, size[2] / 2)
    return FixedBody("box", size, position, tuple(turn), damping=damping, name=name)


def support_body(support: Support, plane: Plane, radius: float, speed: float, name: str) -> FixedBody:
    """The fixed box whose upper face is a support. radius: m, of the largest body; speed: m/s, of the fastest."""
    a, b = plane.to_world(support.start), plane.to_world(support.stop)
    along, into = b - a, plane.directions(support.into)
    into = into / np.linalg.norm(into)
    thickness = max(THICKNESS * radius, STEPS_INSIDE * speed / STEPS_PER_SECOND)
    middle = 0.5 * (a + b) + 0.5 * thickness * into
    angle = -np.arctan2(along[1], along[0])  # about y, which turns x towards -z
    turn = Rotation.from_euler("y", angle).as_quat(scalar_first=True)
    hides = 0.5 * (a + b)[1] * into[1] < 0  # seen from beneath, its near side would hide what stands on it
    front = NARROW if hides else FRONT
    size = (float(np.linalg.norm(along)), (front + BACK) * radius, thickness)
    position = plane.in_space(middle, 0.5 * (BACK - front) * radius)
    damping = None if support.restitution is None else damping_of(support.restitution)
    return FixedBody("box", size, tuple(position), tuple(turn), damping=damping, name=name)


def _fastest(arc: Arc) -> float:
    """px/s, at its beginning or its end."""
    return max(float(np.linalg.norm(arc.velocity_at(arc.time + s * arc.span / 2))) for s in (-1, 1))


def damping_of(restitution: float) -> float:
    """The damping ratio of contacts that return this share of the normal speed."""
    return float(-np.log(np.clip(restitution, 0.05, 0.97)) / SPRING)


def _braking(track: ImageTrack, arc: Arc, plane: Plane, gravity: float) -> float:
    """Sliding friction from the deceleration of an arc on level ground, also where that is not significant."""
    use = np.arange(arc.start, arc.stop)
    use = use[track.whole[use]]
    if len(use) < LEAST_BRAKED:
        return LEAST_FRICTION
    along = arc.velocity / max(float(np.linalg.norm(arc.velocity)), 1e-9)
    path = np.linalg.lstsq(design(track.times[use] - arc.time), track.centre[use] @ along, rcond=None)[0]
    return float(np.clip(-path[2] / plane.px_per_m / gravity, LEAST_FRICTION, MOST_FRICTION))


def sliding_friction(arc: Arc, slope_deg: float, plane: Plane, gravity: float) -> float:
    """Sliding friction from the acceleration of an arc along a slope: down it, friction brakes, up it, it helps to."""
    slope = np.radians(abs(slope_deg))
    size = float(np.linalg.norm(arc.acceleration)) / plane.px_per_m
    uphill = plane.directions(arc.velocity)[1] > 0
    rest = np.sin(slope) - size / gravity
    return float(np.clip((-rest if uphill else rest) / np.cos(slope), LEAST_FRICTION, MOST_FRICTION))
