"""A user's clip: its frames, masks and flow, and what was assumed on the way."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.errors import VideoError
from pipeline.inference.progress import Progress
from pipeline.language.completion import MAX_OBJECTS
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT
from pipeline.vision.flow.supported_flow import supported_flow
from pipeline.vision.recordings.user_clip import UserClip, read_user_clip

STILL_PX = 0.3  # px of 480x320 per frame interval: a slower body does not move
SHAKING_PX = 0.5  # of the background: the camera moves


@dataclass(frozen=True)
class MeasuredClip:
    """What is known of a clip before anything is inferred.

    Attributes:
        taken: Frames and masks.
        schedule: Which moments are frames, and which pairs of them the model sees.
        flow: (P, H, W, 2), px of the frames, of these pairs.
        notes: What was assumed or may be wrong, a sentence each.
    """

    taken: UserClip
    schedule: Schedule
    flow: np.ndarray
    notes: tuple[str, ...]

    @property
    def objects(self) -> int:
        """How many instances the masks have."""
        return int(self.taken.masks.max(initial=0))


def clip_schedule(place: Path, seconds: float) -> Schedule:
    """The frames of a clip of `seconds`. Raises VideoError where they are too few for the model."""
    usual = Schedule()
    if round(seconds * usual.fps) <= usual.model_frames:
        needed = (usual.model_frames + 1) / usual.fps
        raise VideoError(
            f"{place}: {seconds:g} s are too short: the model sees {usual.model_frames} pairs of frames at {usual.fps} "
            f"FPS, for which {needed:.2f} s are needed"
        )
    return Schedule(seconds=seconds)


def measure_clip(
    place: Path,
    estimator: RAFT | DIS,
    flow_size: tuple[int, int],
    flow_iterations: int,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float | None = None,
    masks: Path | None = None,
    progress: Progress | None = None,
) -> MeasuredClip:
    """Read a clip's frames and masks, and measure its flow.

    Args:
        place: A video, or a folder with one and masks.
        estimator: Of flow.
        flow_size: px, width and height, at which the estimator works.
        flow_iterations: Of the estimator.
        start: s, where the clip begins in the video.
        seconds: Its length.
        fps: Frames a second at which it was shot; None for what the file says.
        masks: A file or folder of instance masks; None for those beside the video, or from motion.
        progress: Told of the two steps.

    Raises:
        VideoError: For a video or masks that cannot be used, or where nothing moves.
    """
    progress = progress or Progress()
    schedule = clip_schedule(place, seconds)
    with progress.step("frames and masks"):
        taken = read_user_clip(place, start, seconds, schedule.fps, fps, masks)
    with progress.step("flow"):
        frames, times, pairs, interval = taken.clip.frames, taken.clip.source_times, schedule.pairs, 1 / schedule.fps
        raw = measured_flow(estimator, frames, times, pairs, interval, flow_iterations, flow_size)
        flow = supported_flow(raw, frames, taken.masks, times, pairs, interval=interval, size=flow_size).flow
    speed = np.linalg.norm(flow, axis=-1)
    seen = taken.masks[pairs[:, 0]]
    check_motion(place, speed, seen)
    notes = [*taken.clip.notes, *doubts(speed, seen, seconds)]
    return MeasuredClip(taken, schedule, flow, tuple(notes))


def check_motion(place: Path, speed: np.ndarray, masks: np.ndarray) -> None:
    """Raise VideoError where no instance of masks (P, H, W) ever moves; speed (P, H, W), px."""
    for k in range(len(masks)):
        for i in np.unique(masks[k][masks[k] > 0]):
            if np.median(speed[k][masks[k] == i]) > STILL_PX:
                return
    raise VideoError(
        f"{place}: nothing moves in this clip: the flow in the masks stays below {STILL_PX} px a frame; give another "
        "--start, or --fps if it is slow motion"
    )


def doubts(speed: np.ndarray, masks: np.ndarray, seconds: float) -> list[str]:
    """What makes the answer less sure: a moving camera, a clip of another length than the model learned from."""
    notes = []
    background = [float(np.median(s[m == 0])) for s, m in zip(speed, masks, strict=True) if (m == 0).any()]
    if background and max(background) > SHAKING_PX:
        notes.append(
            f"the flow of the background reaches {max(background):.1f} px a frame: the camera moves, which nothing "
            "here expects, or the flow is measured badly there (flicker, plain walls)"
        )
    if masks.max(initial=0) > MAX_OBJECTS:
        notes.append(
            f"the masks have {masks.max()} objects, more than the {MAX_OBJECTS} of a scene: those from motion may be "
            "in pieces, or show shadows and reflections; --masks gives better ones"
        )
    if abs(seconds - 1) > 1e-6:
        notes.append(f"the clip has {seconds:g} s; the models that ship learned from clips of 1 s")
    return notes
