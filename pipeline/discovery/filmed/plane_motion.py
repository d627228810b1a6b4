"""Measured motion of bodies in a plane, from their outlines and the clips' one camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.discovery.filmed.body_matching import apparent_radius
from pipeline.discovery.filmed.centre_errors import centre_error, independent_frames
from pipeline.discovery.filmed.contact_depth import contact_depth
from pipeline.discovery.filmed.shared_camera import GROUND, UPRIGHT, SharedCamera
from pipeline.discovery.tracks.camera_error import CameraError, camera_error
from pipeline.discovery.tracks.track import LEAST_ROWS, Track
from pipeline.scene.scene import SceneObject, half_extents
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.worlds.arcs import cut_arcs
from pipeline.worlds.bounces import changes_between, meeting_time
from pipeline.worlds.view import find_view

GRID = 6  # points along each side of the picture's part that a track crosses
LARGER = 0.25  # of the logarithm of a radius: a body that looks so much larger or smaller is not in the plane
OFF_GRAVITY = 0.4  # share by which bodies may seem to fall faster or slower
INSTANT = 1e-3  # s
LEAST_HOP = 6  # frames of a hop
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
        bounces = [bounce.time for bounce in _bounces(own)] if camera.plane == UPRIGHT else []
        own = own.part(_in_long_hops(own, bounces))
        if len(own) < LEAST_ROWS:
            notes.append(f"clip {clip}: {name} is left out: it is seen whole in {len(own)} frames only")
            continue
        measured = _track(clip, own, obj, camera, errors[name])
        inside = tuple(t for t in bounces if own.times[0] < t < own.times[-1])
        out.append(replace(measured, bounces=inside))
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
    shown, sigma = independent_frames(own.centre), centre_error(own.centre) * metres
    return Track(clip, obj.name, own.times[shown], place[shown], sigma=sigma[shown], camera_error=error)


def _in_long_hops(track: ImageTrack, bounces: Sequence[float]) -> np.ndarray:
    """(T,) bool, the frames of the first hops in a row that enough frames show; all where nothing bounces.

    Frames next to a bounce do not count, in which a body touches the ground and its shadow. After a hop of fewer
    frames bounces cannot be told from noise.

    Args:
        track: Of a body.
        bounces: Their times, s.
    """
    if not bounces:
        return np.ones(len(track), bool)
    interval = float(np.median(np.diff(track.times)))
    free = np.all([np.abs(track.times - t) >= interval for t in bounces], axis=0)
    hop = np.searchsorted(bounces, track.times)
    long = np.bincount(hop[free], minlength=len(bounces) + 1) >= LEAST_HOP
    first = int(long.argmax())
    last = first + int(np.append(~long[first:], True).argmax())
    return np.asarray(free & (hop >= first) & (hop < last))


@dataclass(frozen=True)
class _Bounce:
    """time: s, at which the flights before and after meet; place: (2,) px, where; velocities (2,) px/s there."""

    time: float
    place: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def ground(self, camera: SharedCamera, reach: float) -> float:
        """m: height of the ground, by a body that reaches so far below its centre."""
        ways = np.stack([-INSTANT * self.before, np.zeros(2), INSTANT * self.after])
        above, lowest, again = camera.places(self.place + ways, reach)[0][:, 2]
        depth = contact_depth((above - lowest) / INSTANT, (again - lowest) / INSTANT)
        return float(lowest + depth - reach)


def _bounces(track: ImageTrack) -> list[_Bounce]:
    """The bounces of a body that falls."""
    out = []
    for a, b in pairwise(cut_arcs(track)):
        time = meeting_time(track, a, b)
        before, after = a.velocity_at(time), b.velocity_at(time)
        if before[1] > 0 > after[1] and changes_between(track, a, b):
            out.append(_Bounce(time, b.position_at(np.array([time]))[0], before, after))
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

    def shift(height: float, true: np.ndarray, numbers: np.ndarray) -> np.ndarray:
        again, _ = project(true, pinhole(camera.moved(numbers).camera), camera.width, camera.height)
        return camera.places(again, height)[0] - true

    out, count = {}, camera.deviations.shape[1]
    for obj in objects:
        height = float(half_extents(obj)[2])
        points, _ = camera.places(px, height)
        out[obj.name] = camera_error(partial(shift, height), points, frame[:, list(axes)], axes, count)
    return out


def with_ground(
    camera: SharedCamera, clips: Sequence[Mapping[str, ImageTrack]], objects: Sequence[SceneObject], ground: float
) -> tuple[SharedCamera, bool]:
    """The camera of an upright plane whose z is counted from the ground that bodies bounce off; and whether any does.

    The flights before and after a bounce meet below the ground, as deep as MuJoCo's contact would have them meet.

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
            floors += [bounce.ground(camera, reach) for bounce in _bounces(track)]
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
