"""The files that `Masks.save` and `dynamics masks` write."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.api.mask_sheet import mask_sheet, overlay_frames
from pipeline.api.masks import Masks
from pipeline.api.result_folder import write_result
from pipeline.inference.progress import Progress
from pipeline.perception.mask_source import WEIGHTS
from pipeline.perception.user_clip import UserClip
from pipeline.shards.content_hash import hash_path
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.appearance import object_colour

SHEET = "masks.png"
_VERSIONS = ("dynamics-pipeline", "numpy", "opencv-python-headless", "torch")


def write_files(folder: Path, found: Masks, progress: Progress) -> None:
    """Write everything into a folder, result.json last."""
    with progress.step("files"):
        write_sheet(folder, found.name, found.taken)
        write_masks(folder, found)
        _write_overlay(folder / "overlay.mp4", found)
    write_result(folder, "masks", _result(found), found.times | progress.seconds)


def write_sheet(folder: Path, name: str, taken: UserClip) -> None:
    """Write masks.png."""
    Image.fromarray(mask_sheet(Path(name).name, taken)).save(folder / SHEET)


def write_masks(folder: Path, found: Masks) -> None:
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
