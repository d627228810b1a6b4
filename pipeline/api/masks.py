"""`pipeline.masks`: the moving bodies of a clip, without any inference."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.api.mask_sheet import overlay_frames, write_sheet
from pipeline.api.result_folder import FolderResult, write_result
from pipeline.bodies.found_bodies import FoundBodies
from pipeline.bodies.mask_source import FAMILIES, WEIGHTS, mask_source
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import UserClip, with_masks
from pipeline.bodies.video_stretch import VideoStretch, read_stretch
from pipeline.errors import ParamsError
from pipeline.inference.measure_clip import say_bodies
from pipeline.inference.progress import Progress
from pipeline.shards.content_hash import hash_path
from pipeline.vision.recordings.corrections import Correction
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.appearance import object_colour

_VERSIONS = ("dynamics-pipeline", "numpy", "opencv-python-headless", "torch")


@dataclass(frozen=True)
class Masks(FolderResult):
    """What `masks` found.

    Attributes:
        name: Of the clip.
        start: s, where the clip begins in the video.
        seconds: Its length.
        fps: Frames a second at which it was shot, where that was given.
        prompts: What was asked for.
        taken: The clip as `infer` takes it: `infer(found.taken)`.
        times: The time that each step took, s.
    """

    name: str
    start: float
    seconds: float
    fps: float | None
    prompts: Prompts
    taken: UserClip
    times: dict[str, float]

    @property
    def found(self) -> FoundBodies:
        """The bodies, their scores and masks (T, H, W) uint8 in the video's own size."""
        assert self.taken.found is not None
        return self.taken.found

    @property
    def masks(self) -> np.ndarray:
        """(T, H, W) uint8: 0 or the body's number, in the video's own size."""
        return self.found.masks

    def write(self, folder: Path, progress: Progress) -> None:
        """Write masks.npz, masks/ (PNGs), masks.png, overlay.mp4 and result.json."""
        with progress.step("files"):
            write_sheet(folder, self.name, self.taken)
            _write_masks(folder, self)
            _write_overlay(folder / "overlay.mp4", self)
        write_result(folder, "masks", _result(self), self.times | progress.seconds)


def masks(
    clip: str | Path,
    *,
    start: float | None = None,
    seconds: float | None = None,
    fps: float | None = None,
    masks: str | None = None,
    prompts: Prompts | None = None,
    correction: Correction | None = None,
    progress: Progress | None = None,
) -> Masks:
    """Find the bodies that move in a clip.

    Args:
        clip: A video, or a folder with one; masks that lie beside it are not used.
        start: s, where the clip begins in the video; None: of a long one, where bodies move freely.
        seconds: Its length; None: as long as they move, at most 12 s, or 1 s from `start` on.
        fps: Frames a second at which it was shot, where the file's header lies.
        masks: `sam2:PATH` or `edgetam:PATH` for a published segmenter that follows what is found; None: our network.
        prompts: What is known of the bodies: points, boxes, their number, what to ignore.
        correction: Of the frames: lens distortion, a camera that shakes a little.
        progress: Told of each step; None: nothing is printed.

    Raises:
        VideoError: For a clip that cannot be used, or in which no body is found.
        ParamsError: For prompts that do not fit the clip.
        ModelError: For a segmenter that cannot be loaded.
    """
    progress = progress or Progress()
    prompts = prompts or Prompts()
    source = mask_source(None, masks, prompts)
    if source.given is not None:
        raise ParamsError(f"masks: {masks} is no segmenter; valid: {', '.join(f'{name}:PATH' for name in FAMILIES)}")
    with progress.step("masks"):
        stretch = VideoStretch(
            place=Path(clip),
            start=start,
            seconds=seconds,
            fps=fps,
            prompts=prompts,
            correction=correction or Correction(),
        )
        read, part = read_stretch(stretch, source)
        taken = with_masks(read, prompts)
    found = Masks(
        name=str(clip),
        start=part.start,
        seconds=part.seconds,
        fps=fps,
        prompts=prompts,
        taken=taken,
        times=dict(progress.seconds),
    )
    notes = [*([part.note] if part.note else []), *found.found.clip.file_notes]
    say_bodies(progress, found.name, part.start, taken, notes)
    return found


def _write_masks(folder: Path, found: Masks) -> None:
    """Write masks.npz, which `--masks` reads, and a PNG a frame whose palette indices are the numbers of the bodies."""
    bodies, clip = found.found.bodies, found.found.clip
    np.savez_compressed(
        folder / "masks.npz",
        masks=found.masks,
        ids=np.arange(1, len(bodies) + 1),
        times=clip.source_times,
        scores=np.array([np.nan if b.score is None else b.score for b in bodies]),
    )
    palette = np.array([(0, 0, 0), *(object_colour(i) for i in range(255))], np.uint8)
    (folder / "masks").mkdir()
    for t, ids in enumerate(found.masks):
        picture = Image.fromarray(ids, "P")
        picture.putpalette(palette.ravel().tolist())
        picture.save(folder / "masks" / f"{t:05d}.png")


def _write_overlay(path: Path, found: Masks) -> None:
    clip = found.found.clip
    labels = [f" {b.label}" for b in found.found.bodies]
    frames = overlay_frames(clip.frames, found.masks, labels)
    write_video(path, frames, clip.times)


def _result(found: Masks) -> dict[str, Any]:
    """The content of result.json."""
    clip, taken = found.found.clip, found.taken.clip
    seen = [np.flatnonzero((found.masks == k).any((1, 2))) for k in range(1, len(found.found.bodies) + 1)]
    return {
        "clip": found.name,
        "assumed": {
            "start_s": found.start,
            "seconds": found.seconds,
            "recorded_fps": round(taken.source_fps, 4),
            "fps_from": "the file" if found.fps is None else "--fps",
            "source_size_px": list(taken.source_size),
            "notes": clip.file_notes,
        },
        "masks": {
            "from": found.taken.masks_from,
            "weights_sha256": hash_path(WEIGHTS),
            "size_px": [found.masks.shape[2], found.masks.shape[1]],
            "frames": len(found.masks),
            "first_s": round(float(clip.source_times[0]), 4),
            "last_s": round(float(clip.source_times[-1]), 4),
        },
        "prompts": found.prompts.record(),
        "bodies": [
            {
                "id": k,
                "score": None if b.score is None else round(b.score, 4),
                "found_by": b.origin,
                "radius_px": None if b.radius_px is None else round(b.radius_px, 2),
                "frames": len(frames),
                "first_s": round(float(clip.source_times[frames[0]]), 4) if len(frames) else None,
                "last_s": round(float(clip.source_times[frames[-1]]), 4) if len(frames) else None,
            }
            for k, (b, frames) in enumerate(zip(found.found.bodies, seen, strict=True), 1)
        ],
        "notes": list(found.found.notes),
        "doubts": list(found.found.doubts),
        "versions": {name: version(name) for name in _VERSIONS},
    }
