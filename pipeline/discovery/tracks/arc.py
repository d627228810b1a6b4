"""Arcs: the smooth stretches of a track between impacts, in the air or on the ground.

The motion within an impact depends on the engine and the material more than on the effects that are looked for.
So each arc has its own initial state, and impacts are compared by the speeds before and after them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.discovery.tracks.camera_error import CameraError
from pipeline.discovery.tracks.smoothing import TrackNoise
from pipeline.discovery.tracks.velocity_jumps import VelocityJump

GROUND = -1
"""`Impact.other` of an impact with the ground."""
FAR_AWAY = 1e6
"""m: coordinate of objects that a clip does not show."""


@dataclass(frozen=True)
class Arc:
    """A smooth stretch of n samples of one object.

    Attributes:
        clip: Which recording.
        object: Index of the object in the scene.
        grounded: On the ground, else in the air.
        time: (n,) s.
        position: (n, 3) m.
        sigma: (n,) m.
        row: (n,) indices of the samples in their track.
        others: (n, M, 3) m, centres of the other objects.
        spin: (n, 3) rad/s, or None.
        quaternion: (n, 4), or None.
        jumps: Velocity jumps within the arc that no known impact explains.
        camera_error: As `Track` has it.
        rolling: Whether a ball on the ground whose spin was not measured is assumed to roll: no other ball has struck
            it, or not recently.
    """

    clip: str
    object: int
    grounded: bool
    time: np.ndarray
    position: np.ndarray
    sigma: np.ndarray
    row: np.ndarray
    others: np.ndarray
    spin: np.ndarray | None = None
    quaternion: np.ndarray | None = None
    jumps: tuple[VelocityJump, ...] = ()
    camera_error: CameraError | None = None
    rolling: bool = False

    @property
    def mean_spin(self) -> np.ndarray | None:
        """(3,) rad/s; None where it was not measured."""
        if self.spin is None or not np.isfinite(self.spin).any():
            return None
        return np.nanmedian(self.spin, axis=0)


@dataclass(frozen=True)
class Impact:
    """An impact with the ground or with another object.

    Attributes:
        clip: Which recording.
        object: Index of the object in the scene.
        other: Index of the other object, or `GROUND`.
        time: s.
        position: (3,) m, of the object.
        before: Index of the arc before the impact; -1 where it is too short.
        after: The same after the impact.
    """

    clip: str
    object: int
    other: int
    time: float
    position: np.ndarray
    before: int
    after: int


@dataclass(frozen=True)
class Cut:
    """All arcs of all tracks, and the impacts between them.

    Attributes:
        arcs: In the order of tracks and times.
        impacts: In the same order.
        noise: Of the tracks.
        outliers: (clip, object, row) of the samples that were removed.
    """

    arcs: tuple[Arc, ...]
    impacts: tuple[Impact, ...]
    noise: TrackNoise
    outliers: frozenset[tuple[str, int, int]]
