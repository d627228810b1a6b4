"""Recordings of rerun: saved to a file, or shown in the viewer.

All recordings have one application id, so that the viewer keeps one layout. The id of a recording is its name.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from pipeline.clips.view import HEIGHT, WIDTH
from pipeline.scene.mjcf import camera_quaternion
from pipeline.scene.scene import Camera
from pipeline.shards.output_errors import writing_to
from pipeline.viewer.footage import Footage
from pipeline.viewer.layout import CAMERA, REPLAYED, blueprint
from pipeline.viewer.motion import log_bodies, log_events, log_plots
from pipeline.viewer.pictures import log_pictures, mask_classes
from pipeline.vision.rendering.camera import focal_px

APPLICATION = "dynamics"


def save_recording(
    name: str, layout: rrb.Blueprint, log_into: Callable[[rr.RecordingStream], None], path: Path
) -> None:
    """Write a recording with its blueprint, under a temporary name that is then replaced.

    Args:
        name: Name and id of the recording.
        layout: The blueprint.
        log_into: Logs the contents.
        path: The file.

    Raises:
        OutputError: The file cannot be written.
    """
    recording = _stream(name)
    stream = rr.binary_stream(recording)
    recording.send_blueprint(layout, make_active=True, make_default=True)
    log_into(recording)
    data = stream.read()
    assert data is not None
    recording.disconnect()
    temporary = path.with_name(path.name + ".part")
    with writing_to(path):
        try:
            temporary.write_bytes(data)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def save(footage: Footage, path: Path) -> None:
    """Write footage as a recording. Raises OutputError."""
    save_recording(footage.name, blueprint(footage), lambda recording: log(recording, footage), path)


def show(shown: Footage | Path) -> None:
    """Open the rerun viewer, which stays open, with footage or with the file of a recording."""
    recording = rr.RecordingStream(APPLICATION) if isinstance(shown, Path) else _stream(shown.name)
    if isinstance(shown, Path):
        recording.spawn()
        recording.log_file_from_path(shown)
    else:
        recording.spawn(default_blueprint=blueprint(shown))
        log(recording, shown)
    recording.flush()
    recording.disconnect()


def _stream(name: str) -> rr.RecordingStream:
    # without the times of day, so that equal runs have equal content
    recording = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.send_recording_name(name)
    return recording


def log(recording: rr.RecordingStream, footage: Footage) -> None:
    """Log footage into a recording."""
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    recording.log("notes", rr.TextDocument(footage.notes, media_type="text/markdown"), static=True, strict=True)
    names = [o.name for o in footage.motions[0].scene.objects] if footage.motions else []
    masks = footage.seen.masks
    count = max(len(names), int(masks.max(initial=0)) if masks is not None else 0)
    names += [f"object {i}" for i in range(len(names), count)]
    recording.log("/", mask_classes(names), static=True, strict=True)
    if footage.motions and footage.motions[0].scene.camera is not None:
        log_camera(recording, footage.motions[0].scene.camera, footage.seen.size or (WIDTH, HEIGHT))
    log_pictures(recording, CAMERA, footage.seen, footage.times)
    log_pictures(recording, REPLAYED, footage.replayed, footage.times)
    for motion in footage.motions:
        log_bodies(recording, motion, footage.times)
        log_plots(recording, motion, footage.times)
        log_events(recording, motion, footage.times, len(footage.motions) > 1)


def log_camera(recording: rr.RecordingStream, camera: Camera, size: tuple[int, int]) -> None:
    """Log the camera of the scene, which does not move. Pictures below its entity appear in its image plane."""
    w, x, y, z = camera_quaternion(camera)
    pose = rr.Transform3D(translation=camera.position, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
    lens = rr.Pinhole(
        focal_length=focal_px(camera.fov, size[1]),
        width=size[0],
        height=size[1],
        camera_xyz=rr.ViewCoordinates.RUB,
        image_plane_distance=0.4,
    )
    recording.log(CAMERA, pose, lens, static=True, strict=True)
