"""From masks to a planar scene: tracks, view, scale, a first scene, and the fit of its simulation to the tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.motion.arcs import Arc, cut_arcs
from pipeline.motion.image_track import ImageTrack, image_tracks
from pipeline.motion.view import View, find_view
from pipeline.planar.fit import PlanarFit, fit_planar
from pipeline.planar.parameters import planar_parameters
from pipeline.planar.plane import Plane
from pipeline.planar.planar_scene import planar_scene
from pipeline.planar.scale import GRAVITY, Scale, find_scale
from pipeline.planar.silhouette import Silhouette, silhouette
from pipeline.planar.supports import Support, find_supports
from pipeline.scene.scene import Scene


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
    """

    tracks: tuple[ImageTrack, ...]
    arcs: tuple[tuple[Arc, ...], ...]
    view: View
    silhouettes: tuple[Silhouette, ...]
    scale: Scale
    plane: Plane
    supports: tuple[Support, ...]


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


def measure_motion(
    masks: np.ndarray, frames: np.ndarray, times: np.ndarray, *, px_per_m: float | None = None, gravity: float = GRAVITY
) -> ClipMotion:
    """Tracks, view, shapes, scale and supports of a clip.

    Args:
        masks: (T, H, W) ids.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s, from 0.
        px_per_m: Where a length is known.
        gravity: m/s².
    """
    tracks, arcs = [], []
    for track in image_tracks(masks, times):
        own = cut_arcs(track)
        if own:
            tracks.append(track)
            arcs.append(tuple(own))
    view = find_view(tracks, arcs)
    silhouettes = tuple(silhouette(t, masks, frames) for t in tracks)
    scale = find_scale(view, silhouettes, gravity) if px_per_m is None else Scale(px_per_m, "length", 0.01)
    roll = 0.0 if view.gravity_px is None else float(np.arctan2(view.gravity_px[0], view.gravity_px[1]))
    plane = Plane(masks.shape[2], masks.shape[1], scale.px_per_m, roll, view.kind == "top")
    supports: Sequence[Support] = [] if view.kind in ("top", "table") else find_supports(view, tracks, masks)
    return ClipMotion(tuple(tracks), tuple(arcs), view, silhouettes, scale, plane, tuple(supports))


def find_planar_scene(motion: ClipMotion, gravity: float = GRAVITY) -> PlanarAnswer:
    """The planar scene whose simulation follows the tracks.

    Where gravity fixes the scale, the fit's gravity, in the metres that were assumed first, tells how long a metre is.
    Where a length is known, gravity is what the fit finds.
    """
    start = planar_scene(
        motion.view,
        motion.tracks,
        motion.arcs,
        motion.silhouettes,
        motion.supports,
        plane=motion.plane,
        gravity=gravity,
        start=0.0,
    )
    fit = fit_planar(start, motion.tracks, motion.plane, planar_parameters(start, motion.plane))
    if motion.scale.by != "gravity":
        return PlanarAnswer(motion, fit, fit.scene, motion.scale)
    factor = gravity / float(np.linalg.norm(fit.scene.gravity))
    scale = replace(motion.scale, px_per_m=motion.scale.px_per_m / factor)
    return PlanarAnswer(motion, fit, scaled(fit.scene, factor), scale)


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
