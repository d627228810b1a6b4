"""Which moments of a clip are frames, and which frames the model sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scene.time_step import STEPS_PER_SECOND, frame_steps

LEAST_FRAMES, LEAST_SECONDS = 5, 0.15  # of a clip that was filmed


@dataclass(frozen=True)
class Schedule:
    """`seconds` of video, of which `model_frames` uniformly spaced moments go to the model.

    At each of those the model sees a frame and the flow to a later one, which is scaled to the interval 1 / `fps`. In
    a rendered clip the frames are 1 / `fps` apart, and the flow leads to the next frame. A filmed clip has its own
    frames: the model sees those that are nearest.

    Attributes:
        seconds: Length of the clip.
        fps: Frames a second of a rendered clip; its inverse is the interval to which flow refers.
        model_frames: Moments that the model sees.
        filmed: s from the first one, when the frames of a filmed clip were recorded; empty for a rendered clip.
    """

    seconds: float = 1.0
    fps: int = 30
    model_frames: int = 10
    filmed: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        assert self.filmed or self.model_frames < self.frames

    @staticmethod
    def of_frames(times: Sequence[float] | np.ndarray) -> Schedule:
        """The schedule of frames that were filmed at times (F,), s, which increase from 0."""
        at = tuple(float(t) for t in times)
        return Schedule(seconds=at[-1] + float(np.median(np.diff(at))), filmed=at)

    @property
    def frames(self) -> int:
        return len(self.filmed) or round(self.seconds * self.fps)

    @property
    def times(self) -> np.ndarray:
        """(frames,) s from the first one."""
        return np.array(self.filmed) if self.filmed else np.arange(self.frames) / self.fps

    @property
    def rate(self) -> float:
        """Frames a second, the mean of a filmed clip."""
        return (self.frames - 1) / self.filmed[-1] if self.filmed else self.fps

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
        if not self.filmed:
            first = np.arange(self.model_frames) * self.frames // self.model_frames
            return np.stack([first, first + 1], 1)
        moments = np.arange(self.model_frames) * self.seconds / self.model_frames
        first = np.minimum(self._nearest(moments), self.frames - 2)
        return np.stack([first, np.maximum(self._nearest(self.times[first] + 1 / self.fps), first + 1)], 1)

    @property
    def pair_scale(self) -> np.ndarray:
        """(model_frames,) the interval 1 / `fps` over the time between the two frames of each pair."""
        if not self.filmed:
            return np.ones(self.model_frames)
        apart = np.diff(self.times[self.pairs], axis=1)[:, 0]
        return np.asarray(1 / (self.fps * apart))

    def _nearest(self, moments: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(self.times - moments[:, None]).argmin(1))

    def first(self, seconds: float) -> Schedule:
        """The schedule of the first part of the clip alone, with the same frames. Raises ValueError where the model's
        frames cannot be parted there."""
        every = self.seconds / self.model_frames
        seen = round(seconds / every)
        if self.filmed:
            kept = tuple(t for t in self.filmed if t < seconds - 1e-6)
            possible = len(kept) > 1 and 0 < seen < self.model_frames and abs(seconds - seen * every) < 1e-6
            part = Schedule(seconds, self.fps, seen, kept) if possible else self
        else:
            frames = round(seconds * self.fps)
            seen = int((self.pairs[:, 1] < frames).sum())
            possible = 0 < seen < frames < self.frames
            part = Schedule(frames / self.fps, self.fps, seen) if possible else self
        if part is not self and np.array_equal(part.pairs, self.pairs[:seen]):
            return part
        raise ValueError(f"{seconds:g} s; valid: multiples of {every:g} s, less than {self.seconds:g}")
