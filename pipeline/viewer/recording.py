"""Footage as a rerun recording: to a file, or into the viewer.

One application id for all recordings, so that the viewer keeps one layout; the recording's id is the clip.
"""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from pipeline.scene.mjcf import camera_quaternion
from pipeline.scene.scene import Camera
from pipeline.shards.output_errors import writing_to
from pipeline.viewer.footage import Footage
from pipeline.viewer.layout import CAMERA, REPLAYED, blueprint
from pipeline.viewer.motion import log_bodies, log_events, log_plots
from pipeline.viewer.pictures import log_pictures, mask_classes
from pipeline.vision.rendering.camera import focal_px

APPLICATION = "dynamics"
DEFAULT_SIZE = (480, 320)


def save(footage: Footage, path: Path) -> None:
    """Write the recording with its blueprint, under a temporary name that is then renamed. Raises OutputError."""
    recording = _stream(footage)
    stream = rr.binary_stream(recording)
    recording.send_blueprint(blueprint(footage), make_active=True, make_default=True)
    log(recording, footage)
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


def show(footage: Footage) -> None:
    """Open the rerun viewer, which stays open, and send it the recording."""
    recording = _stream(footage)
    recording.spawn(default_blueprint=blueprint(footage))
    log(recording, footage)
    recording.flush()
    recording.disconnect()


def show_file(path: Path) -> None:
    """Open the rerun viewer, which stays open, on a recording that was saved."""
    recording = rr.RecordingStream(APPLICATION)
    recording.spawn()
    recording.log_file_from_path(path)
    recording.flush()
    recording.disconnect()


def _stream(footage: Footage) -> rr.RecordingStream:
    recording = rr.RecordingStream(APPLICATION, recording_id=footage.name)
    recording.send_recording_name(footage.name)
    return recording


def log(recording: rr.RecordingStream, footage: Footage) -> None:
    """Everything of the footage, into a recording."""
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    recording.log("notes", rr.TextDocument(footage.notes, media_type="text/markdown"), static=True, strict=True)
    names = [o.name for o in footage.motions[0].scene.objects] if footage.motions else []
    masks = footage.seen.masks
    count = max(len(names), int(masks.max(initial=0)) if masks is not None else 0)
    names += [f"object {i}" for i in range(len(names), count)]
    recording.log("/", mask_classes(names), static=True, strict=True)
    if footage.motions and footage.motions[0].scene.camera is not None:
        log_camera(recording, footage.motions[0].scene.camera, footage.seen.size or DEFAULT_SIZE)
    log_pictures(recording, CAMERA, footage.seen, footage.fps)
    log_pictures(recording, REPLAYED, footage.replayed, footage.fps)
    for motion in footage.motions:
        log_bodies(recording, motion, footage.fps)
        log_plots(recording, motion, footage.fps)
        log_events(recording, motion, footage.fps, len(footage.motions) > 1)


def log_camera(recording: rr.RecordingStream, camera: Camera, size: tuple[int, int]) -> None:
    """The scene's pinhole camera, which stands still; pictures below it are seen in its image plane."""
    w, x, y, z = camera_quaternion(camera)
    pose = rr.Transform3D(translation=camera.position, quaternion=rr.Quaternion(xyzw=(x, y, z, w)))
    lens = rr.Pinhole(focal_length=focal_px(camera.fov, size[1]), width=size[0], height=size[1],
                      camera_xyz=rr.ViewCoordinates.RUB, image_plane_distance=0.4)  # fmt: skip
    recording.log(CAMERA, pose, lens, static=True, strict=True)
