"""Tracks by registering known outlines to masks, and the camera that these tracks tell of, in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.filmed.outline import outline
from pipeline.filmed.recorded_clip import RecordedClip
from pipeline.filmed.registration import register_outline
from pipeline.filmed.shared_camera import SharedCamera, fit_camera
from pipeline.motion.image_track import ImageTrack, centre_sigma
from pipeline.scene.scene import SceneObject
from pipeline.vision.rendering.camera import pinhole

ROUNDS = 3  # of registering outlines and fitting the camera
Tracks = tuple[Mapping[str, ImageTrack], ...]
"""For each clip, by name of the object."""


def camera_and_tracks(
    clips: Sequence[RecordedClip],
    tracks: Sequence[Mapping[str, ImageTrack]],
    objects: Sequence[SceneObject],
    plane: str,
) -> tuple[SharedCamera, Tracks]:
    """The clips' camera, and tracks of the bodies' centres (not of their outlines' centroids) with the areas that their
    outlines have without shadows.

    Args:
        clips: Of one camera.
        tracks: For each clip, of the masks, by name of the object.
        objects: With known sizes.
        plane: In which bodies move, of `shared_camera`.
    """
    width, height = clips[0].size
    registered: Tracks = tuple(tracks)
    camera = fit_camera(registered, objects, plane, width, height)
    bodies = {o.name: o for o in objects}
    for _ in range(ROUNDS):
        registered = tuple(
            {name: _registered(clip, own[name], bodies[name], camera) for name in own}
            for clip, own in zip(clips, tracks, strict=True)
        )
        camera = fit_camera(registered, objects, plane, width, height)
    return camera, registered


def _registered(clip: RecordedClip, track: ImageTrack, obj: SceneObject, camera: SharedCamera) -> ImageTrack:
    """The track of a body by its registered outlines, without the frames in which none fits."""
    place, _ = camera.centre_places(track, obj)
    expected, eye = camera.radii(track, obj), pinhole(camera.camera)
    rows, centres, areas = [], [], []
    for k, frame in enumerate(track.frames):
        found = register_outline(clip.masks[frame] == track.body, outline(obj, place[k], eye, *clip.size))
        if found is not None:
            rows.append(k)
            centres.append(found.centre)
            areas.append(np.pi * (found.scale * expected[k]) ** 2)
    if not rows:
        return track.part(np.zeros(0, int))
    kept = track.part(np.array(rows))
    centre = np.array(centres)
    return replace(kept, centre=centre, area=np.array(areas), sigma=centre_sigma(centre))
