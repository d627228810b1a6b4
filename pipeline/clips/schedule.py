"""Which moments of a clip are frames, and which frames the model sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.scene.time_step import STEPS_PER_SECOND


@dataclass(frozen=True)
class Schedule:
    """`seconds` of video at `fps`, of which `model_frames` uniformly spaced ones go to the model.

    Each of those is the first of a pair of neighbouring frames: its flow leads to the frame after it. So there are
    fewer of them than frames.
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
    def steps(self) -> int:
        """Simulation steps in the clip."""
        return round(self.seconds * STEPS_PER_SECOND)

    @property
    def frame_steps(self) -> np.ndarray:
        """(frames,) simulation step of every frame."""
        return np.rint(np.arange(self.frames) * STEPS_PER_SECOND / self.fps).astype(np.int64)

    @property
    def pairs(self) -> np.ndarray:
        """(model_frames, 2) frame indices of the pairs whose flow the model sees."""
        first = np.arange(self.model_frames) * self.frames // self.model_frames
        return np.stack([first, first + 1], 1)

    def first(self, seconds: float) -> Schedule:
        """The schedule of the first part of the clip alone, with the same frames. Raises ValueError where the model's
        frames cannot be parted there."""
        frames = round(seconds * self.fps)
        seen = int((self.pairs[:, 1] < frames).sum())
        if 0 < seen < frames < self.frames:
            part = Schedule(frames / self.fps, self.fps, seen)
            if np.array_equal(part.pairs, self.pairs[:seen]):
                return part
        every = self.seconds / self.model_frames
        raise ValueError(f"{seconds:g} s; valid: multiples of {every:g} s, less than {self.seconds:g}")
