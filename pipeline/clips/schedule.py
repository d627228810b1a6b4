"""Which moments of a clip are frames, and which frames the model sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scene.time_step import STEPS_PER_SECOND, frame_steps


@dataclass(frozen=True)
class Schedule:
    """`seconds` of video at `fps`, of which `model_frames` uniformly spaced ones go to the model.

    Each of those is the first of a pair of frames: its flow leads to the frame after it.
    """

    seconds: float = 1.0
    fps: int = 30
    model_frames: int = 10

    def __post_init__(self) -> None:
        assert self.model_frames < self.frames

    @property
    def frames(self) -> int:
        return round(self.seconds * self.fps)

    @property
    def times(self) -> np.ndarray:
        """(frames,) s from the first one."""
        return np.arange(self.frames) / self.fps

    @property
    def steps(self) -> int:
        """Simulation steps in the clip."""
        return round(self.seconds * STEPS_PER_SECOND)

    @property
    def frame_steps(self) -> np.ndarray:
        """(frames,) simulation step of every frame."""
        return frame_steps(self.times)

    @property
    def pairs(self) -> np.ndarray:
        """(model_frames, 2) frame indices of the pairs whose flow the model sees."""
        first = np.arange(self.model_frames) * self.frames // self.model_frames
        return np.stack([first, first + 1], 1)

    @property
    def pair_scale(self) -> np.ndarray:
        """(model_frames,) the interval 1 / `fps` over the time between the two frames of each pair."""
        return np.ones(self.model_frames)

    def first(self, seconds: float) -> Schedule:
        """The schedule of the first part of the clip alone, with the same frames. Raises ValueError where the model's
        frames cannot be parted there."""
        frames = round(seconds * self.fps)
        seen = int((self.pairs[:, 1] < frames).sum())
        if 0 < seen < frames < self.frames:
            part = Schedule(frames / self.fps, self.fps, seen)
            if np.array_equal(part.pairs, self.pairs[:seen]):
                return part
        raise _not_parted(self, seconds)


@dataclass(frozen=True)
class FilmedSchedule(Schedule):
    """Frames with the times at which they were filmed.

    The model sees those that are nearest to its moments, and of each the flow to the frame that is nearest to an
    interval 1 / `fps` later, which is scaled to that interval.

    Attributes:
        filmed: (F,) s from the first one, increasing.
    """

    filmed: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        assert len(self.filmed) > 1

    @staticmethod
    def of(times: Sequence[float] | np.ndarray) -> FilmedSchedule:
        """The schedule of frames that were filmed at times (F,), s, which increase from 0."""
        at = tuple(float(t) for t in times)
        return FilmedSchedule(seconds=at[-1] + float(np.median(np.diff(at))), filmed=at)

    @property
    def frames(self) -> int:
        return len(self.filmed)

    @property
    def times(self) -> np.ndarray:
        return np.array(self.filmed)

    @property
    def rate(self) -> float:
        """Frames a second, in the mean."""
        return (self.frames - 1) / self.filmed[-1]

    @property
    def pairs(self) -> np.ndarray:
        moments = np.arange(self.model_frames) * self.seconds / self.model_frames
        first = np.minimum(self._nearest(moments), self.frames - 2)
        return np.stack([first, np.maximum(self._nearest(self.times[first] + 1 / self.fps), first + 1)], 1)

    @property
    def pair_scale(self) -> np.ndarray:
        return np.asarray(1 / (self.fps * np.diff(self.times[self.pairs], axis=1)[:, 0]))

    def _nearest(self, moments: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(self.times - moments[:, None]).argmin(1))

    def first(self, seconds: float) -> FilmedSchedule:
        every = self.seconds / self.model_frames
        seen = round(seconds / every)
        kept = tuple(t for t in self.filmed if t < seconds - 1e-6)
        if len(kept) > 1 and 0 < seen < self.model_frames and abs(seconds - seen * every) < 1e-6:
            part = FilmedSchedule(seconds, self.fps, seen, kept)
            if np.array_equal(part.pairs, self.pairs[:seen]):
                return part
        raise _not_parted(self, seconds)


def _not_parted(schedule: Schedule, seconds: float) -> ValueError:
    every = schedule.seconds / schedule.model_frames
    return ValueError(f"{seconds:g} s; valid: multiples of {every:g} s, less than {schedule.seconds:g}")
