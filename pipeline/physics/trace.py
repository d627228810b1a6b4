"""The trace of a simulation: the states at all steps, and all contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Body index of the ground in contacts. Fixed body k of the scene has the index FIRST_FIXED - k.
GROUND, FIRST_FIXED = -1, -2


@dataclass(frozen=True)
class Contacts:
    """One row per contact point and step, in order of time.

    Attributes:
        step: (C,) the contact acts from `step` to `step + 1`.
        first: (C,) index of the first object.
        second: (C,) index of the second object; `GROUND` for the ground, `FIRST_FIXED` - k for fixed body k. Neither
            is ever first.
        position: (C, 3) m, world frame.
        normal: (C, 3) unit vector from second to first.
        distance: (C,) m, negative where they overlap.
        force: (C, 3) N, world frame, on first.
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
    """States of N objects at S + 1 times, in the world frame.

    Attributes:
        rate: Steps per second.
        position: (S+1, N, 3) m.
        quaternion: (S+1, N, 4).
        velocity: (S+1, N, 3) m/s.
        angular_velocity: (S+1, N, 3) rad/s.
        contacts: All contacts.
    """

    rate: int
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    contacts: Contacts

    @property
    def times(self) -> np.ndarray:
        """(S+1,) s."""
        return np.arange(len(self.position)) / self.rate
