"""Measured motion of bodies in a plane, from their outlines and the clips' one camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from pipeline.discrepancy.tracks.camera_error import CameraError, camera_error
from pipeline.discrepancy.tracks.track import LEAST_ROWS, Track
from pipeline.filmed.body_matching import apparent_radius
from pipeline.filmed.shared_camera import GROUND, UPRIGHT, SharedCamera
from pipeline.motion.arcs import cut_arcs
from pipeline.motion.image_track import ImageTrack
from pipeline.motion.view import find_view
from pipeline.planar.bounces import changes_between, meeting_time
from pipeline.scene.scene import SceneObject, half_extents
from pipeline.vision.rendering.camera import pinhole, project

LEAST_SIGMA_PX = 0.05
GRID = 6  # points along each side of the picture's part that a track crosses
LARGER = 0.25  # of the logarithm of a radius: a body that looks so much larger or smaller is not in the plane
OFF_GRAVITY = 0.4  # share by which bodies may seem to fall faster or slower
OUT_OF_PLANE = 0.5  # share of a track's frames that may be out of the plane


def plane_tracks(
    clip: str,
    tracks: Mapping[str, ImageTrack],
    objects: Sequence[SceneObject],
    camera: SharedCamera,
    errors: Mapping[str, CameraError],
) -> tuple[list[Track], list[str]]:
    """The measured motion of a clip's bodies, with what each deviation of the camera changes; and notes.

    Args:
        clip: Name of the recording.
        tracks: By name of the object.
        objects: Of the scene.
        camera: Of all clips.
        errors: `camera_errors`.
    """
    out, notes = [], []
    bodies = {o.name: o for o in objects}
    for name, track in tracks.items():
        obj, own = bodies[name], track.part(track.whole)
        if len(own) >= LEAST_ROWS:
            off = np.abs(np.log(np.sqrt(own.area / np.pi) / camera.radii(own, obj)))
            if (off > LARGER).mean() > OUT_OF_PLANE:
                notes.append(f"clip {clip}: {name} is left out: by its size it is not in the plane of the others")
                continue
            own = own.part(off <= LARGER)
        if camera.plane == UPRIGHT and len(own) >= LEAST_ROWS:
            own = own.part(~_touching(own))
        if len(own) < LEAST_ROWS:
            notes.append(f"clip {clip}: {name} is left out: it is seen whole in {len(own)} frames only")
            continue
        out.append(_track(clip, own, obj, camera, errors[name]))
    return out, notes


def _track(clip: str, own: ImageTrack, obj: SceneObject, camera: SharedCamera, error: CameraError) -> Track:
    place, depth = camera.centre_places(own, obj)
    metres = depth / camera.focal
    if camera.plane == GROUND:
        rise = (camera.position[2] - place[:, 2]) / np.linalg.norm(place - camera.position, axis=1)
        metres = metres / np.sqrt(np.maximum(rise, 0.1))
        place[:, 2] = half_extents(obj)[2]
    else:
        place[:, 1] = 0.0
    sigma = max(own.sigma, LEAST_SIGMA_PX) * metres
    return Track(clip, obj.name, own.times, place, sigma=sigma, camera_error=error)


def _touching(track: ImageTrack) -> np.ndarray:
    """(T,) bool, the frames next to a bounce, in which a body touches the ground and its shadow."""
    interval = float(np.median(np.diff(track.times)))
    out = np.zeros(len(track), bool)
    for time, _ in _bounces(track):
        out |= np.abs(track.times - time) < interval
    return out


def _bounces(track: ImageTrack) -> list[tuple[float, np.ndarray]]:
    """Times, s, and places (2,) px of the bounces of a body that falls."""
    out = []
    for a, b in pairwise(cut_arcs(track)):
        time = meeting_time(track, a, b)
        falls = a.velocity_at(time)[1] > 0 > b.velocity_at(time)[1]
        if falls and changes_between(track, a, b):
            out.append((time, b.position_at(np.array([time]))[0]))
    return out


def camera_errors(
    tracks: Sequence[Mapping[str, ImageTrack]], objects: Sequence[SceneObject], camera: SharedCamera
) -> dict[str, CameraError]:
    """What each deviation of the camera changes in what is measured, by name of the object.

    Args:
        tracks: For each clip, by name of the object.
        objects: Of the scene.
        camera: Of all clips.
    """
    seen = np.concatenate([t.centre for clip in tracks for t in clip.values()])
    grid = np.linspace(seen.min(0), seen.max(0), GRID)
    px = np.stack(np.meshgrid(*grid.T), -1).reshape(-1, 2)
    axes = (0, 1) if camera.plane == GROUND else (0, 2)
    frame, _ = camera.places(px, float(half_extents(objects[0])[2]))

    def shift(true: np.ndarray, height: float, numbers: np.ndarray) -> np.ndarray:
        again, _ = project(true, pinhole(camera.moved(numbers).camera), camera.width, camera.height)
        return camera.places(again, height)[0] - true

    out = {}
    for obj in objects:
        height = float(half_extents(obj)[2])
        points, _ = camera.places(px, height)
        of_object = partial(_at_height, shift, height)
        out[obj.name] = camera_error(of_object, points, frame[:, list(axes)], axes, camera.deviations.shape[1])
    return out


def _at_height(
    shift: Callable[[np.ndarray, float, np.ndarray], np.ndarray], height: float, true: np.ndarray, numbers: np.ndarray
) -> np.ndarray:
    return shift(true, height, numbers)


def with_ground(
    camera: SharedCamera, clips: Sequence[Mapping[str, ImageTrack]], objects: Sequence[SceneObject], ground: float
) -> tuple[SharedCamera, bool]:
    """The camera of an upright plane whose z is counted from the ground that bodies bounce off; and whether any does.

    Args:
        camera: With z counted from anywhere.
        clips: For each clip the tracks by name of the object.
        objects: Of the scene.
        ground: m, height of the ground in the scene.
    """
    assert camera.plane == UPRIGHT
    bodies = {o.name: o for o in objects}
    floors = []
    for clip in clips:
        for name, track in clip.items():
            reach = float(half_extents(bodies[name])[2])
            floors += [float(camera.places(place[None], reach)[0][0, 2]) - reach for _, place in _bounces(track)]
    if not floors:
        return camera, False
    return replace(camera, lift=camera.lift + ground - float(np.median(floors))), True


def plane_of(tracks: Sequence[Mapping[str, ImageTrack]], objects: Sequence[SceneObject], gravity: float) -> str:
    """`UPRIGHT` where in most clips bodies fall in the picture as fast as bodies of their size should, else `GROUND`.

    Args:
        tracks: For each clip, by name of the object.
        objects: With known sizes.
        gravity: m/s².
    """
    bodies = {o.name: o for o in objects}
    falling = 0
    for clip in tracks:
        own = list(clip.values())
        view = find_view(own, [cut_arcs(t) for t in own])
        if view.gravity_px is not None:
            px_per_m = np.median([t.radius / apparent_radius(bodies[name]) for name, t in clip.items()])
            falling += bool(abs(np.linalg.norm(view.gravity_px) / px_per_m / gravity - 1) < OFF_GRAVITY)
    return UPRIGHT if 2 * falling > len(tracks) else GROUND
