"""`pipeline.masks`: the moving bodies of a clip, without any inference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.api.result_folder import FolderResult
from pipeline.errors import ParamsError
from pipeline.inference.measure_clip import say_bodies
from pipeline.inference.progress import Progress
from pipeline.perception.found_bodies import FoundBodies
from pipeline.perception.mask_source import FAMILIES, mask_source
from pipeline.perception.prompts import Prompts
from pipeline.perception.user_clip import UserClip, with_masks
from pipeline.perception.video_stretch import VideoStretch, read_stretch
from pipeline.vision.recordings.corrections import Correction


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
        from pipeline.api.mask_files import write_files

        write_files(folder, self, progress)


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
