"""From masks to a planar scene: tracks, view, scale, a first scene, and the fit of its simulation to the tracks."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack, image_tracks
from pipeline.scene.scene import HOLLOW_SHAPES, Scene, SceneObject
from pipeline.worlds.apparent_size import with_apparent_sizes
from pipeline.worlds.arcs import Arc, cut_arcs
from pipeline.worlds.blocks import Block
from pipeline.worlds.bounces import changes_between, meeting_time
from pipeline.worlds.fit import PlanarFit, fit_planar
from pipeline.worlds.hanging import hanging_scene
from pipeline.worlds.parameters import planar_parameters
from pipeline.worlds.planar_scene import planar_object, planar_scene
from pipeline.worlds.plane import Plane
from pipeline.worlds.scale import GRAVITY, KNOWN, Scale, find_scale
from pipeline.worlds.silhouette import Silhouette, silhouette
from pipeline.worlds.supports import Support, find_supports, find_walls
from pipeline.worlds.table_view import TableView, table_view
from pipeline.worlds.tilt import Tilt, find_tilt
from pipeline.worlds.tumbling import Tumbling, tumbling
from pipeline.worlds.upright import camera_roll
from pipeline.worlds.view import UPRIGHT, View, find_view, growth

START_HOLLOW = 0.6
KNOWN_ERROR = 0.01  # of a size that is given, as a share
BACKGROUND_FRAMES = 15  # whose median is the background


@dataclass(frozen=True)
class ClipMotion:
    """What the tracks of a clip tell, before any simulation.

    Attributes:
        tracks: Of the bodies that can be measured.
        arcs: Of each track.
        view: Of the world.
        silhouettes: Of each body.
        scale: Of the plane in which they move.
        plane: That plane.
        supports: What carries bodies, and what they bounce off.
        flat: The tracks in the picture of the plane: of a table that is seen from aside, as if from straight above; of
            a camera that is turned, as if it looked straight at the plane. Arcs, view, silhouettes, scale, supports
            and blocks are in that picture, too.
        table: How the camera sees a table from aside; None for other views.
        solids: Of each body that turns freely in the air, its shape, orientation and spin; None of others.
        blocks: Fixed bodies that a user pointed at, in the picture of the plane.
    """

    tracks: tuple[ImageTrack, ...]
    arcs: tuple[tuple[Arc, ...], ...]
    view: View
    silhouettes: tuple[Silhouette, ...]
    scale: Scale
    plane: Plane
    supports: tuple[Support, ...]
    flat: tuple[ImageTrack, ...]
    table: TableView | None
    solids: tuple[Tumbling | None, ...]
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class PlanarAnswer:
    """A planar scene and how well it follows the tracks.

    Attributes:
        motion: What the tracks tell.
        fit: The fit; its scene has the scale that was first assumed.
        scene: The scene in metres, with the clip's gravity.
        scale: Of the picture, after the fit.
    """

    motion: ClipMotion
    fit: PlanarFit
    scene: Scene
    scale: Scale


@dataclass(frozen=True)
class KnownSize:
    """A body's size that is known.

    Attributes:
        index: Of the body, from 0, in the order of the scene's objects.
        key: "radius", "width" or "height", as the picture shows it.
        m: Its length.
    """

    index: int
    key: str
    m: float


def measure_motion(
    masks: np.ndarray,
    frames: np.ndarray,
    times: np.ndarray,
    *,
    view: str | None = None,
    gravity: float = GRAVITY,
    scale: Scale | None = None,
    size: KnownSize | None = None,
    blocks: Sequence[Block] = (),
) -> ClipMotion:
    """Tracks, view, shapes, scale and supports of a clip.

    Args:
        masks: (T, H, W) ids.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s, from 0.
        view: Of `pipeline.worlds.view.VIEWS`, where it is known.
        gravity: m/s².
        scale: Where it is known.
        size: Where a body's size is known.
        blocks: Fixed bodies that are known, in the picture.

    Raises:
        ValueError: The tracks do not fit the view, or there is no body of that size's index.
    """
    tracks, arcs = [], []
    for track in image_tracks(masks, times):
        own = cut_arcs(track)
        if own:
            tracks.append(track)
            arcs.append(tuple(own))
    silhouettes = tuple(silhouette(t, masks, frames) for t in tracks)
    level, sizes = Plane(masks.shape[2], masks.shape[1], 1.0, level=True), growth(tracks)
    found = find_view(tracks, arcs, camera_roll(background(frames)), view, level.focal)
    flat = tracks
    turned = _turned(tracks, arcs, found, silhouettes, level) if found.kind in UPRIGHT else None
    if turned is not None:
        tilt, flat, arcs, found = turned
        level = replace(level, tilt=tilt)
        silhouettes = tuple(
            replace(s, width=s.width * f.radius / t.radius, height=s.height * f.radius / t.radius)
            for s, t, f in zip(silhouettes, tracks, flat, strict=True)
        )
        blocks = [Block(tilt.straight(b.corners)) for b in blocks]
        scale = None if scale is None else scale.seen_straight(tilt)
    if scale is None and size is not None:
        scale = Scale(size_px(silhouettes, size) / size.m, "size", KNOWN_ERROR)
    elif scale is None:
        scale = find_scale(found, silhouettes, gravity)
    if found.kind in ("table", "top"):
        plane = replace(level, px_per_m=scale.px_per_m)
    else:
        plane = replace(level, px_per_m=scale.px_per_m, roll=-float(np.radians(found.roll_deg)), level=False)
    motion = ClipMotion(
        tracks=tuple(tracks),
        arcs=tuple(arcs),
        view=found,
        silhouettes=silhouettes,
        scale=scale,
        plane=plane,
        supports=(),
        flat=tuple(flat),
        table=None,
        solids=(None,) * len(tracks),
        blocks=tuple(blocks),
    )
    if found.kind == "table":
        balls = bool(tracks) and all(s.shape == "sphere" for s in silhouettes)
        return seen_from_above(motion, table_view(plane, sizes, tracks)) if balls else motion
    if found.kind == "hanging":
        return motion
    solids = tuple(
        None if s.disc else tumbling(t, f, masks[: _in_the_air(f, own, found)], times, plane)
        for t, f, own, s in zip(tracks, flat, arcs, silhouettes, strict=True)
    )
    return replace(motion, supports=tuple(find_supports(found, tracks, flat, masks, blocks)), solids=solids)


def _turned(
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    view: View,
    silhouettes: Sequence[Silhouette],
    plane: Plane,
) -> tuple[Tilt, list[ImageTrack], list[tuple[Arc, ...]], View] | None:
    """The turn of the camera from one that looks straight at the plane; tracks, arcs and view as that one sees them.

    None where the tracks do not determine a turn.
    """
    straight = Tilt(0.0, 0.0, plane.focal, (plane.width / 2, plane.height / 2))

    def seen(tilt: Tilt) -> tuple[list[ImageTrack], list[tuple[Arc, ...]], View]:
        flat = [tilt.straight_track(t) for t in tracks]
        cut = [tuple(cut_arcs(t)) for t in flat]
        return flat, cut, replace(find_view(flat, cut, view.roll_deg, view.kind), reason=view.reason)

    try:
        # A turned camera's picture of a long flight is no parabola and is cut into several arcs. So they are cut again
        # in the picture of the likeliest turn.
        _, longer, same = seen(find_tilt(tracks, arcs, view, silhouettes, straight, likeliest=True))
        tilt = find_tilt(tracks, longer, same, silhouettes, straight)
        return None if tilt.none else (tilt, *seen(tilt))
    except ValueError:  # so seen, the tracks do not show the view
        return None


def _in_the_air(track: ImageTrack, arcs: Sequence[Arc], view: View) -> int:
    """How many of the clip's frames, from the first on, show a body before it touches anything."""
    kinds = [m.kind for m in view.arcs if m.arc.body == track.body]
    last = 0
    if kinds[0] != "free":
        return 0
    while last + 1 < len(arcs) and kinds[last + 1] == "free" and not changes_between(track, arcs[last], arcs[last + 1]):
        last += 1
    return int(track.frames[arcs[last].stop - 1]) + 1


def seen_from_above(motion: ClipMotion, table: TableView) -> ClipMotion:
    """The motion of balls on a table, with arcs and sizes as if seen from straight above."""
    flat = [table.from_above(t)[0] for t in motion.tracks]
    arcs = [tuple(cut_arcs(t)) for t in flat]
    view = replace(find_view(flat, arcs, kind="table"), reason=motion.view.reason)
    silhouettes = tuple(
        replace(s, width=2 * t.radius, height=2 * t.radius) for s, t in zip(motion.silhouettes, flat, strict=True)
    )
    blocks = tuple(table.block_from_above(b) for b in motion.blocks)
    return replace(
        motion,
        arcs=tuple(arcs),
        view=view,
        silhouettes=silhouettes,
        blocks=blocks,
        supports=tuple(find_walls(view, flat, blocks)),
        flat=tuple(flat),
        table=table,
    )


def size_px(silhouettes: Sequence[Silhouette], size: KnownSize) -> float:
    """px that a known size has in the picture. Raises ValueError where there is no such body."""
    if size.index >= len(silhouettes):
        raise ValueError(f"there is no body {size.index}; valid: 0 to {len(silhouettes) - 1}")
    own = silhouettes[size.index]
    return {"radius": own.width / 2, "width": own.width, "height": own.height}[size.key]


def background(frames: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) uint8 of frames (T, H, W, 3) without what moves."""
    some = frames[np.linspace(0, len(frames) - 1, min(len(frames), BACKGROUND_FRAMES)).round().astype(int)]
    return np.median(some, axis=0).astype(np.uint8)


def find_planar_scene(
    motion: ClipMotion,
    gravity: float = GRAVITY,
    threads: int = 1,
    first: PlanarAnswer | None = None,
    quick: bool = False,
) -> PlanarAnswer:
    """The planar scene whose simulation follows the tracks.

    Where gravity fixes the scale, the fit's gravity, in the metres that were assumed first, tells how long a metre is;
    where bodies hit something, the scene is fitted again in these metres. Where a length is known, gravity is what
    the fit finds.

    Args:
        motion: What the tracks tell.
        gravity: m/s².
        threads: For simulations.
        first: Of the clip's first part: the fit goes on from its scene. None: it begins with what the tracks tell.
        quick: Fit by descents alone.
    """
    if motion.view.kind == "hanging":
        return _hanging_answer(motion, gravity)
    if first is not None:
        motion = replace(motion, plane=first.motion.plane, scale=first.motion.scale, table=first.motion.table)
        if motion.table is None:
            motion = replace(motion, flat=tuple(motion.plane.straight_track(t) for t in motion.tracks))
    rolls = motion.view.kind == "incline" and motion.scale.by in KNOWN
    along = _begins_along(motion)
    start = _start(motion, gravity, rolls, along) if first is None else first.fit.scene
    gravity_shows = not motion.plane.level and not rolls
    parameters = planar_parameters(start, motion.plane, along, gravity=gravity_shows, hollow=rolls)
    jumps = impacts(motion)
    fit = fit_planar(start, motion.flat, motion.plane, parameters, jumps, threads, quick)
    if motion.table is not None:
        return PlanarAnswer(motion, fit, replace(fit.scene, camera=motion.table.camera()), motion.scale)
    if motion.scale.by != "gravity":
        return PlanarAnswer(motion, fit, fit.scene, motion.scale)
    factor = gravity / float(np.linalg.norm(fit.scene.gravity))
    scale = replace(motion.scale, px_per_m=motion.scale.px_per_m / factor)
    scene = scaled(fit.scene, factor)
    if not jumps:
        return PlanarAnswer(motion, fit, scene, scale)
    # A contact is not the same in other units, and each bounce multiplies the difference.
    motion = replace(motion, scale=scale, plane=replace(motion.plane, px_per_m=scale.px_per_m))
    parameters = planar_parameters(scene, motion.plane, along, gravity=False, hollow=rolls)
    again = fit_planar(scene, motion.flat, motion.plane, parameters, jumps, threads, quick)
    again = replace(again, simulations=fit.simulations + again.simulations)
    return PlanarAnswer(motion, again, again.scene, scale)


def _hanging_answer(motion: ClipMotion, gravity: float) -> PlanarAnswer:
    """The scene of bodies that hang. Their swings were fitted to the tracks already."""

    def scene_in(plane: Plane) -> Scene:
        objects = [
            planar_object(motion.view, t, own, s, plane=plane, gravity=gravity, carried=False)
            for t, own, s in zip(motion.flat, motion.arcs, motion.silhouettes, strict=True)
        ]
        return hanging_scene(objects, motion.view.swings, plane)

    scene, scale = scene_in(motion.plane), motion.scale
    if scale.by == "gravity":  # the body's own inertia slows the swing by a share that does not depend on the scale
        scale = replace(scale, px_per_m=scale.px_per_m * -scene.gravity[2] / gravity)
        motion = replace(motion, plane=replace(motion.plane, px_per_m=scale.px_per_m), scale=scale)
        scene = replace(scene_in(motion.plane), gravity=(0.0, 0.0, -gravity))
    off = [
        np.linalg.norm(s.places(t.times) - t.centre, axis=1)[t.whole]
        for s, t in zip(motion.view.swings, motion.flat, strict=True)
    ]
    rms = float(np.sqrt((np.concatenate(off) ** 2).mean() / 2))
    return PlanarAnswer(motion, PlanarFit(scene, rms, simulations=0), scene, scale)


def _begins_along(motion: ClipMotion) -> list[np.ndarray | None]:
    """Of each body, the direction (3,) of the support along which it moves at first; None where none carries it."""
    kinds = {(m.arc.body, m.arc.start): m.kind for m in motion.view.arcs}
    out: list[np.ndarray | None] = []
    for own in motion.arcs:
        carried = not motion.plane.level and kinds[own[0].body, own[0].start] in ("slope", "straight")
        ways = [s.along for s in motion.supports] if carried else []
        way = max(ways, key=lambda w: abs(float(w @ own[0].velocity)), default=None)
        out.append(None if way is None else motion.plane.in_space(motion.plane.axes @ way))
    return out


def _start(motion: ClipMotion, gravity: float, rolls: bool, along: Sequence[np.ndarray | None]) -> Scene:
    """The scene that the tracks tell of.

    Args:
        motion: What the tracks tell.
        gravity: m/s².
        rolls: Bodies may roll, and a known length tells how hollow they are.
        along: Of `_begins_along`.
    """
    start = planar_scene(
        motion.view,
        motion.flat,
        motion.arcs,
        motion.silhouettes,
        motion.supports,
        motion.solids,
        motion.blocks,
        plane=motion.plane,
        gravity=gravity,
    )
    if motion.table is None:
        start = with_apparent_sizes(start, motion.tracks, motion.flat, motion.plane, [s is None for s in motion.solids])
    objects = [
        o if way is None else replace(o, velocity=tuple((way @ o.velocity) * way))
        for o, way in zip(start.objects, along, strict=True)
    ]
    return replace(start, objects=tuple(_half_hollow(o) if rolls else o for o in objects))


def impacts(motion: ClipMotion) -> list[float]:
    """Times, s, at which the velocity of a body jumps."""
    out = []
    for track, own in zip(motion.flat, motion.arcs, strict=True):
        for a, b in itertools.pairwise(own):
            if changes_between(track, a, b):
                out.append(meeting_time(track, a, b))
    return out


def _half_hollow(body: SceneObject) -> SceneObject:
    """A body that rolls, between solid and thin-walled, from where its inertia is fitted."""
    rolls = body.shape in HOLLOW_SHAPES and any(body.angular_velocity)
    return replace(body, hollow=START_HOLLOW) if rolls else body


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all lengths times a factor, and times as they are: the same pictures."""

    def times(vector: Sequence[float]) -> tuple[float, ...]:
        return tuple(factor * v for v in vector)

    objects = tuple(
        replace(
            o,
            size=times(o.size),
            position=times(o.position),
            velocity=times(o.velocity),
            rolling_friction=factor * o.rolling_friction,
        )
        for o in scene.objects
    )
    fixed = tuple(replace(b, size=times(b.size), position=times(b.position)) for b in scene.fixed)
    camera = scene.camera and replace(scene.camera, position=times(scene.camera.position))
    ground = None if scene.ground is None else factor * scene.ground
    return replace(scene, objects=objects, fixed=fixed, camera=camera, ground=ground, gravity=times(scene.gravity))
