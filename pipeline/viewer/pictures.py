"""The pictures of a camera in the viewer: RGB, masks, depth, and flow in the colours of the colour wheel."""

from __future__ import annotations

import cv2
import numpy as np
import rerun as rr

from pipeline.viewer.footage import Pictures
from pipeline.viewer.timeline import at_frames
from pipeline.vision.flow.flow_picture import flow_picture
from pipeline.vision.rendering.appearance import object_colour

JPEG_QUALITY = 92
MASK_OPACITY = 0.35
_MILLIMETRES = 1000.0


def log_pictures(recording: rr.RecordingStream, path: str, pictures: Pictures, clock: np.ndarray) -> None:
    """Log the pictures under `path`/rgb, masks, depth and flow."""
    if pictures.rgb is not None:
        blobs = [_encoded(".jpg", p[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]) for p in pictures.rgb]
        _send_blobs(recording, f"{path}/rgb", np.arange(len(blobs)), clock, blobs, "image/jpeg", draw_order=-10.0)
    if pictures.flow is not None:
        longest = max(float(np.linalg.norm(pictures.flow, axis=-1).max(initial=0.0)), 1e-3)
        shown = flow_picture(pictures.flow, "wheel", longest)
        blobs = [_encoded(".png", p[..., ::-1]) for p in shown]
        _send_blobs(recording, f"{path}/flow", pictures.frames, clock, blobs, "image/png", draw_order=-9.0)
    if pictures.depth is not None:
        log_depth(recording, f"{path}/depth", pictures.depth, pictures.frames, clock)
    if pictures.masks is not None:
        log_masks(recording, f"{path}/masks", pictures.masks, clock)


def log_masks(recording: rr.RecordingStream, path: str, masks: np.ndarray, clock: np.ndarray) -> None:
    """Log instance masks (F, H, W) in the colours of the objects."""
    style = rr.SegmentationImage.from_fields(opacity=MASK_OPACITY, draw_order=10.0)
    recording.log(path, style, static=True, strict=True)
    height, width = masks.shape[1:]
    kind = rr.components.ImageFormat(width=width, height=height, channel_datatype=rr.ChannelDatatype.U8)
    columns = rr.SegmentationImage.columns(
        buffer=list(np.ascontiguousarray(masks).reshape(len(masks), -1)), format=[kind] * len(masks)
    )
    recording.send_columns(path, at_frames(np.arange(len(masks)), clock), columns, strict=True)


def log_depth(
    recording: rr.RecordingStream, path: str, depth: np.ndarray, frames: np.ndarray, clock: np.ndarray
) -> None:
    """Log planar depths (P, H, W) m of frames (P,) as PNGs in mm; 0 for the background."""
    finite = np.isfinite(depth)
    millimetres = np.where(finite, np.clip(depth * _MILLIMETRES, 0, 65535), 0).astype(np.uint16)
    near, far = (float(q) for q in np.quantile(depth[finite], [0, 0.98])) if finite.any() else (0.0, 1.0)
    style = rr.EncodedDepthImage.from_fields(
        meter=_MILLIMETRES,
        depth_range=[near * _MILLIMETRES, far * _MILLIMETRES],
        media_type="image/png",
        draw_order=-8.0,
    )
    recording.log(path, style, static=True, strict=True)
    columns = rr.EncodedDepthImage.columns(blob=[_encoded(".png", d) for d in millimetres])
    recording.send_columns(path, at_frames(frames, clock), columns, strict=True)


def mask_classes(names: list[str]) -> rr.AnnotationContext:
    """Names and colours of mask ids: 0 for the background, i + 1 for object i."""
    return rr.AnnotationContext(
        [
            rr.AnnotationInfo(0, "background", (0, 0, 0, 0)),
            *(rr.AnnotationInfo(i + 1, name, object_colour(i)) for i, name in enumerate(names)),
        ]
    )


def _encoded(suffix: str, picture: np.ndarray, options: list[int] | None = None) -> bytes:
    done, data = cv2.imencode(suffix, np.ascontiguousarray(picture), options or [])
    assert done
    return data.tobytes()


def _send_blobs(
    recording: rr.RecordingStream,
    path: str,
    frames: np.ndarray,
    clock: np.ndarray,
    blobs: list[bytes],
    media: str,
    draw_order: float,
) -> None:
    recording.log(path, rr.EncodedImage.from_fields(media_type=media, draw_order=draw_order), static=True, strict=True)
    recording.send_columns(path, at_frames(frames, clock), rr.EncodedImage.columns(blob=blobs), strict=True)
