"""Measured motion of a clip's bodies in metres: the replay's poses, moved and turned so that their outlines are those
of the tracks.

A body is moved parallel to the picture, at the depth that it has in the replay, and turned about the camera's axis.
What an outline does not show of its orientation is that of the replay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import ImageTrack, image_tracks
from pipeline.clips.replay import states_at
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.vision.recordings.letterbox import Letterbox
from pipeline.vision.rendering.camera import focal_px, pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.worlds.arcs import SYSTEMATIC

NUMBERS = ("time", "x", "y", "z", "qw", "qx", "qy", "qz", "sigma", "angle_sigma")  # columns of `track_table`
LONG = 1.15  # ratio of an outline's axes from which its angle counts


@dataclass(frozen=True)
class BodyTrack:
    """The measured motion of one body.

    Attributes:
        name: Of the scene's object.
        times: (T,) s from the clip's beginning.
        position: (T, 3) m, measured.
        replayed: (T, 3) m, of the replay.
        quaternion: (T, 4), measured about the camera's axis where the outline is longer than wide.
        sigma: (T,) m, standard error of each coordinate parallel to the picture.
        angle_sigma: (T,) rad, standard error of the angle about the camera's axis; NaN where it is not measured.
    """

    name: str
    times: np.ndarray
    position: np.ndarray
    replayed: np.ndarray
    quaternion: np.ndarray
    sigma: np.ndarray
    angle_sigma: np.ndarray


def body_tracks(scene: Scene, tracks: Mapping[int, ImageTrack], width: int, height: int) -> list[BodyTrack]:
    """The measured motion of a scene's bodies.

    Args:
        scene: The answer; it has a camera.
        tracks: By index of the object, in px of the camera's picture, with times from the scene's beginning.
        width: px, of that picture.
        height: px.

    Raises:
        SimulationError: The replay becomes unstable.
    """
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    steps = np.unique(np.concatenate([[0], *(_steps(t) for t in tracks.values())])).astype(np.int64)
    states = states_at(scene, steps)
    shown = rasterise(
        scene.objects, states.position[0], states.quaternion[0], camera, width, height, scene.ground, scene.fixed
    ).mask
    outlines = {t.body - 1: t for t in image_tracks(shown, steps / STEPS_PER_SECOND)}
    out = []
    for i, track in sorted(tracks.items()):
        own, at = track.part(track.whole), np.searchsorted(steps, _steps(track)[track.whole])
        position = states.position[0, at, i]
        seen, depth = project(position, camera, width, height)
        metres = depth / focal_px(camera.fov_y_deg, height)
        offset, turn = _differences(own, outlines.get(i), at, seen)
        off = (own.centre - offset - seen) * metres[:, None]
        moved = position + off[:, :1] * camera.rotation_world[:, 0] - off[:, 1:] * camera.rotation_world[:, 1]
        turned = Rotation.from_rotvec(-np.nan_to_num(turn)[:, None] * camera.rotation_world[:, 2]) * Rotation.from_quat(
            states.quaternion[0, at, i], scalar_first=True
        )
        sigma = float(np.hypot(own.sigma, SYSTEMATIC * track.radius))
        length = own.axes[:, 0] - own.axes[:, 1]  # px by which a turn of 1 rad moves the outline's ends, about
        out.append(
            BodyTrack(
                name=scene.objects[i].name,
                times=own.times,
                position=moved,
                replayed=position,
                quaternion=turned.as_quat(canonical=True, scalar_first=True),
                sigma=sigma * metres,
                angle_sigma=np.where(np.isnan(turn), np.nan, sigma / np.maximum(length, 1e-6)),
            )
        )
    return out


def _steps(track: ImageTrack) -> np.ndarray:
    return np.asarray(np.rint(track.times * STEPS_PER_SECOND).astype(np.int64))


def _differences(
    track: ImageTrack, replayed: ImageTrack | None, at: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How the replay's outline differs from its pose, and from the track.

    Args:
        track: Measured, T samples.
        replayed: The track of the replay's outlines; None where they are never seen.
        at: (T,) the replay's frames of these samples.
        seen: (T, 2) px, where the replay's centres are.

    Returns:
        (T, 2) px, the outline's centre less that of the body; 0 where the replay does not show it whole. (T,) rad, the
        angle, clockwise, from the replay's outline to the track's; NaN where one of them is nearly round.
    """
    offset, turn = np.zeros((len(track), 2)), np.full(len(track), np.nan)
    if replayed is None:
        return offset, turn
    row = np.searchsorted(replayed.frames, at).clip(0, len(replayed) - 1)
    there = (replayed.frames[row] == at) & replayed.whole[row]
    offset[there] = (replayed.centre[row] - seen)[there]
    long = there & (track.axes[:, 0] > LONG * track.axes[:, 1])
    long &= replayed.axes[row, 0] > LONG * replayed.axes[row, 1]
    turn[long] = ((track.angle - replayed.angle[row] + np.pi / 2) % np.pi - np.pi / 2)[long]
    return offset, turn


def clip_track(track: ImageTrack, letterbox: Letterbox) -> ImageTrack:
    """A track in the video's own picture as one in the picture that a letterbox makes of it."""
    return track.in_picture(letterbox.scale, np.array(letterbox.place[:2]))


def objects_of(pairs: np.ndarray, in_order: bool, tracks: list[ImageTrack]) -> dict[int, ImageTrack]:
    """The tracks by index of the object whose motion they are.

    Args:
        pairs: (P, 2) object and instance of the clip, from 0.
        in_order: The scene's objects are the tracks' bodies, in order.
        tracks: Of the bodies, which number the instances.
    """
    if in_order:
        return dict(enumerate(tracks))
    by_body = {t.body: t for t in tracks}
    return {int(i): by_body[int(j) + 1] for i, j in pairs if int(j) + 1 in by_body}


def track_table(clip: str, tracks: list[BodyTrack]) -> pa.Table:
    """The tracks as measured motion (docs/formats.md): a row for each body and time."""
    if not tracks:
        return pa.table({})
    numbers = np.concatenate(
        [np.column_stack([t.times, t.position, t.quaternion, t.sigma, t.angle_sigma]) for t in tracks]
    )
    names = [t.name for t in tracks for _ in t.times]
    return pa.table({"clip": [clip] * len(names), "object": names} | dict(zip(NUMBERS, numbers.T, strict=True)))
