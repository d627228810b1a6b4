"""What a simulation leaves behind: the state at every step and every contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GROUND = -1  # the body index of the ground in contacts


@dataclass(frozen=True)
class Contacts:
    """One row per contact point and step, in the order of time.

    step (C,): the contact acts from `step` to `step + 1`. first, second (C,): object indices, `GROUND` for the
    ground, which is always `second`. position (C, 3) m, world. normal (C, 3): unit, from second to first.
    distance (C,) m, negative where they overlap. force (C, 3) N, world, on first.
    """

    step: np.ndarray
    first: np.ndarray
    second: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    force: np.ndarray

    def __len__(self) -> int:
        return len(self.step)


@dataclass(frozen=True)
class Trace:
    """States of N objects at S + 1 times: position (S+1, N, 3) m, quaternion (S+1, N, 4), velocity and
    angular_velocity (S+1, N, 3), all in the world's frame; `rate` steps a second."""

    rate: int
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    contacts: Contacts

    @property
    def times(self) -> np.ndarray:
        return np.arange(len(self.position)) / self.rate

    def steps_at(self, times: np.ndarray) -> np.ndarray:
        """The steps nearest to `times`, s."""
        return np.clip(np.rint(np.asarray(times) * self.rate).astype(int), 0, len(self.position) - 1)
