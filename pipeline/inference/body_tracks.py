"""Measured motion of a clip's bodies in metres: the replay's poses, moved so that they agree with the tracks.

A body is moved parallel to the picture, at the depth that it has in the replay, until its centre is where that of its
outline is. Its orientation is that of the replay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.clips.replay import states_at
from pipeline.motion.image_track import ImageTrack
from pipeline.scene.mjcf import STEPS_PER_SECOND
from pipeline.scene.scene import Scene
from pipeline.vision.recordings.letterbox import Letterbox
from pipeline.vision.rendering.camera import focal_px, pinhole, project


@dataclass(frozen=True)
class BodyTrack:
    """The measured motion of one body.

    Attributes:
        name: Of the scene's object.
        times: (T,) s from the clip's beginning.
        position: (T, 3) m, measured.
        replayed: (T, 3) m, of the replay.
        quaternion: (T, 4) of the replay.
        sigma: (T,) m, standard error of each coordinate parallel to the picture.
    """

    name: str
    times: np.ndarray
    position: np.ndarray
    replayed: np.ndarray
    quaternion: np.ndarray
    sigma: np.ndarray


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
    steps = {i: np.rint(t.times * STEPS_PER_SECOND).astype(np.int64) for i, t in tracks.items()}
    every = np.arange(max((s[-1] for s in steps.values()), default=0) + 1)
    states = states_at(scene, every)
    out = []
    for i, track in sorted(tracks.items()):
        whole = track.whole
        position = states.position[0, steps[i][whole], i]
        seen, depth = project(position, camera, width, height)
        metres = depth / focal_px(camera.fov_y_deg, height)
        off = (track.centre[whole] - seen) * metres[:, None]
        moved = position + off[:, :1] * camera.rotation_world[:, 0] - off[:, 1:] * camera.rotation_world[:, 1]
        out.append(
            BodyTrack(
                name=scene.objects[i].name,
                times=track.times[whole],
                position=moved,
                replayed=position,
                quaternion=states.quaternion[0, steps[i][whole], i],
                sigma=track.sigma * metres,
            )
        )
    return out


def clip_track(track: ImageTrack, letterbox: Letterbox) -> ImageTrack:
    """A track in the video's own picture as one in the picture that a letterbox makes of it."""
    scale = letterbox.place[2] / letterbox.window[2]
    return track.in_picture(scale, np.array(letterbox.place[:2]) - scale * np.array(letterbox.window[:2]))


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


def track_table(clip: str, tracks: list[BodyTrack]) -> pd.DataFrame:
    """The tracks as measured motion (docs/formats.md): a row for each body and time."""
    rows = []
    for track in tracks:
        table = pd.DataFrame({"clip": clip, "object": track.name, "time": track.times})
        table[["x", "y", "z"]] = track.position
        table[["qw", "qx", "qy", "qz"]] = track.quaternion
        table["sigma"] = track.sigma
        rows.append(table)
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame()
