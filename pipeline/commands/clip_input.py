"""The user's clip as `dynamics infer` works on it: frames, masks, flow, and what was assumed on the way."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.commands.progress import Progress
from pipeline.errors import VideoError
from pipeline.vision.dis import DIS
from pipeline.vision.raft import RAFT
from pipeline.vision.user_clip import UserClip, read_user_clip

FLOW_SIZE = (240, 160)  # px at which the flow is measured
FLOW_ITERATIONS = 12
STILL_PX = 0.3  # px of 480x320 per frame interval: a slower body does not move
SHAKING_PX = 0.5  # of the background: the camera moves
LEAST_FRAMES = 11  # ten pairs of neighbours


@dataclass(frozen=True)
class ClipInput:
    """taken: frames and masks; flow (P, H, W, 2), px of the frames, of the schedule's pairs; notes: what was assumed or
    may be wrong, a sentence each."""

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
    schedule = Schedule(seconds=seconds)
    if not seconds > 0 or schedule.frames < LEAST_FRAMES:
        raise VideoError(f"{place}: {seconds:g} s are too short: the model sees {schedule.model_frames} pairs of frames at "
                         f"{schedule.fps} FPS, for which {LEAST_FRAMES / schedule.fps:.2f} s are needed")  # fmt: skip
    return schedule


def read_input(
    place: Path, start: float, seconds: float, fps: float | None, masks: Path | None, estimator: RAFT | DIS,
    progress: Progress,
) -> ClipInput:  # fmt: skip
    """Frames, masks and flow of a clip. Raises VideoError for a video or masks that cannot be used, or without motion."""
    schedule = clip_schedule(place, seconds)
    with progress.step("frames and masks"):
        taken = read_user_clip(place, start, seconds, schedule.fps, fps, masks)
    with progress.step("flow"):
        frames, pairs = taken.clip.frames, schedule.pairs
        flow = estimator.flow(frames[pairs[:, 0]], frames[pairs[:, 1]], FLOW_ITERATIONS, size=FLOW_SIZE)
    speed = np.linalg.norm(flow, axis=-1)
    seen = taken.masks[pairs[:, 0]]
    check_motion(place, speed, seen)
    notes = [*taken.clip.notes, *doubts(speed, seen, seconds)]
    return ClipInput(taken, schedule, flow, tuple(notes))


def check_motion(place: Path, speed: np.ndarray, masks: np.ndarray) -> None:
    """Raise VideoError where no instance of masks (P, H, W) ever moves; speed (P, H, W), px."""
    for k in range(len(masks)):
        for i in np.unique(masks[k][masks[k] > 0]):
            if np.median(speed[k][masks[k] == i]) > STILL_PX:
                return
    raise VideoError(f"{place}: nothing moves in this clip: the flow in the masks stays below {STILL_PX} px a frame; "
                     "give another --start, or --fps if it is slow motion")  # fmt: skip


def doubts(speed: np.ndarray, masks: np.ndarray, seconds: float) -> list[str]:
    """What makes the answer less sure: a moving camera, a clip of another length than the model learned from."""
    notes = []
    background = [float(np.median(s[m == 0])) for s, m in zip(speed, masks, strict=True) if (m == 0).any()]
    if background and max(background) > SHAKING_PX:
        notes.append(f"the background moves by up to {max(background):.1f} px a frame: the camera is taken to rest, so this "
                     "clip is not what the model and the search expect")  # fmt: skip
    if abs(seconds - 1) > 1e-6:
        notes.append(f"the clip has {seconds:g} s; the models that ship learned from clips of 1 s")
    return notes
