"""Measured motion of several clips of one camera, with what is not known of the camera.

Nothing here is simulated: positions are where outlines of known shape are found, so that they owe nothing to a
simulation that may lack an effect. What sizes of outlines do not tell of the camera is left open (`CameraError`), and
the discovery fits it with every model alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.filmed.body_matching import match_bodies
from pipeline.discovery.filmed.outline_tracks import camera_and_tracks
from pipeline.discovery.filmed.plane_motion import camera_errors, plane_of, plane_tracks, with_ground
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.discovery.filmed.shared_camera import GROUND, UPRIGHT, SharedCamera
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.track import Track
from pipeline.errors import MeasurementError


@dataclass(frozen=True)
class MeasuredMotion:
    """What several clips show.

    Attributes:
        clips: With the masks of the scene's objects, numbered from 1 in the order of the scene.
        tracks: Measured.
        known: The known scene; without a ground where bodies fly and never bounce.
        camera: Of all clips.
        notes: How it was measured, a sentence each.
    """

    clips: tuple[RecordedClip, ...]
    tracks: tuple[Track, ...]
    known: KnownScene
    camera: SharedCamera
    notes: tuple[str, ...]


def measure_motion(clips: Sequence[RecordedClip], known: KnownScene, plane: str | None = None) -> MeasuredMotion:
    """Measure the motion of a scene's objects in clips of one camera.

    Args:
        clips: With masks.
        known: The scene.
        plane: In which bodies move, of `shared_camera`; None: their fall tells.

    Raises:
        MeasurementError: For clips that cannot be of one camera, bodies that cannot be matched, or none that is seen
            long enough.
    """
    sizes = {clip.size for clip in clips}
    if len(sizes) > 1:
        shown = ", ".join(f"{clip.name} {clip.size[0]}x{clip.size[1]}" for clip in clips)
        raise MeasurementError(f"the clips have pictures of different sizes ({shown}); valid: clips of one camera")
    scene = known.scene
    for obj in scene.objects:
        if obj.shape not in ("sphere", "cylinder"):
            raise MeasurementError(
                f"object {obj.name}: a {obj.shape} cannot be followed in clips; valid: spheres and standing cylinders"
            )
    matching = match_bodies(clips, scene.objects)
    plane = plane or plane_of(matching.tracks, scene.objects, float(np.linalg.norm(scene.gravity)))
    camera, seen = camera_and_tracks(matching.clips, matching.tracks, scene.objects, plane)
    notes = [matching.how, _camera_words(camera)]
    if plane == UPRIGHT and scene.ground is not None:
        camera, bounces = with_ground(camera, seen, scene.objects, scene.ground)
        if not bounces:
            known = replace(known, scene=replace(scene, ground=None))
            notes.append("no body bounces: the ground is left out")
    tracks: list[Track] = []
    errors = camera_errors(seen, scene.objects, camera)
    for clip, own in zip(matching.clips, seen, strict=True):
        found, more = plane_tracks(clip.name, own, scene.objects, camera, errors)
        tracks += found
        notes += more
    if not tracks:
        raise MeasurementError(f"no body is seen whole for long enough in any clip: {'; '.join(notes[2:])}")
    order = {o.name: i for i, o in enumerate(scene.objects, 1)}
    numbered = [
        _renumbered(clip, {t.body: order[name] for name, t in own.items()})
        for clip, own in zip(matching.clips, matching.tracks, strict=True)
    ]
    return MeasuredMotion(tuple(numbered), tuple(tracks), known, camera, tuple(notes))


def _renumbered(clip: RecordedClip, numbers: dict[int, int]) -> RecordedClip:
    table = np.zeros(256, np.uint8)
    for body, number in numbers.items():
        table[body] = number
    return replace(clip, masks=table[clip.masks])


def _camera_words(camera: SharedCamera) -> str:
    errors, pitch = np.sqrt(np.diag(camera.covariance)), round(np.degrees(camera.numbers[1]))
    view = "looks down at the ground" if camera.plane == GROUND else "looks from the side"
    return (
        f"one camera for all clips {view}: pitch {pitch} ± {np.degrees(errors[1]):.0f}°, "
        f"vertical field of view {camera.camera.fov:.0f} ± {camera.camera.fov * errors[0]:.0f}°, distance "
        f"{np.exp(camera.numbers[4]):.2f} ± {np.exp(camera.numbers[4]) * errors[4]:.2f} m, by the outlines' sizes"
    )
