"""Tracks by registering known outlines to masks, and the camera that these tracks tell of, in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import theilslopes

from pipeline.bodies.tracks.image_track import ImageTrack, centre_sigma
from pipeline.discovery.filmed.outline import outline
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.discovery.filmed.registration import register_outline
from pipeline.discovery.filmed.shared_camera import SharedCamera, fit_camera
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
    """The track of a body by its registered outlines, without the frames in which none fits.

    In each frame the place and the scale of the outline are found. Where a shadow belongs to the mask in some frames
    only, both jump. A rigid body's scale relative to the one that the camera predicts changes steadily, so a line is
    fitted to the scales of all frames, and the place is found again with these scales.
    """
    place, _ = camera.centre_places(track, obj)
    expected, eye = camera.radii(track, obj), pinhole(camera.camera)
    masks = [clip.masks[frame] == track.body for frame in track.frames]
    shapes = [outline(obj, where, eye, *clip.size) for where in place]
    free = {k: found for k, mask in enumerate(masks) if (found := register_outline(mask, shapes[k])) is not None}
    rows = list(free)
    kept = track.part(np.array(rows, int))
    if not rows:
        return kept
    scale = np.array([found.scale for found in free.values()])
    offset = np.median(np.array([found.centre for found in free.values()]) - kept.centre, axis=0)
    begins = zip(kept.centre + offset, _steady(kept.times, scale), strict=True)
    centre = np.array(
        [(register_outline(masks[k], shapes[k], b) or free[k]).centre for k, b in zip(rows, begins, strict=True)]
    )
    return replace(kept, centre=centre, area=np.pi * (scale * expected[rows]) ** 2, sigma=centre_sigma(centre))


def _steady(times: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Scales (T,) without jumps: a straight line through their logarithms over times (T,) s (Theil and Sen)."""
    if len(scale) < 3:
        return scale
    line = theilslopes(np.log(scale), times)
    return np.asarray(np.exp(line.intercept + line.slope * times))
