"""Collisions of two bodies, found where two tracks bend at one time and place."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc

NEAR = 1.4  # sums of radii, the largest distance of the centres
LEAST_SPEED = 0.05  # of the faster body's speed: relative speed along the line of centres that counts


@dataclass(frozen=True)
class Collision:
    """Two bodies that hit each other.

    Attributes:
        first: Index of one track.
        second: Index of the other.
        time: s.
        restitution: Speed of separation over that of approach, along the line of centres; 0 to 1.
        mass_ratio: Mass of the second body over that of the first, by the momenta that they exchange.
    """

    first: int
    second: int
    time: float
    restitution: float
    mass_ratio: float


def find_collisions(tracks: Sequence[ImageTrack], arcs: Sequence[Sequence[Arc]]) -> list[Collision]:
    """The collisions of each pair of bodies, in order of time."""
    found: list[Collision] = []
    for i in range(len(tracks)):
        for j in range(i + 1, len(tracks)):
            for time in _bends(tracks[i], arcs[i]) + _bends(tracks[j], arcs[j]):
                collision = _collision(i, j, time, tracks, arcs)
                if collision and all(
                    c.first != i or c.second != j or abs(c.time - time) > _gap(tracks[i]) for c in found
                ):
                    found.append(collision)
    return sorted(found, key=lambda c: c.time)


def _gap(track: ImageTrack) -> float:
    """s, of three frames."""
    return 3 * float(np.median(np.diff(track.times)))


def _bends(track: ImageTrack, arcs: Sequence[Arc]) -> list[float]:
    """Times, s, between the arcs of a track."""
    return [0.5 * (track.times[a.stop - 1] + track.times[b.start]) for a, b in itertools.pairwise(arcs)]


def _collision(
    i: int, j: int, time: float, tracks: Sequence[ImageTrack], arcs: Sequence[Sequence[Arc]]
) -> Collision | None:
    before_i, before_j = (_velocity(arcs[k], time, True) for k in (i, j))
    after_i, after_j = (_velocity(arcs[k], time, False) for k in (i, j))
    if before_i is None or before_j is None or after_i is None or after_j is None:
        return None
    places = [_place(tracks[k], time) for k in (i, j)]
    line = places[1] - places[0]
    distance = float(np.linalg.norm(line))
    if distance == 0 or distance > NEAR * (tracks[i].radius + tracks[j].radius):
        return None
    line = line / distance
    approach, separation = float((before_i - before_j) @ line), float((after_j - after_i) @ line)
    fastest = max(np.linalg.norm(before_i), np.linalg.norm(before_j))
    if approach < LEAST_SPEED * fastest or separation < -LEAST_SPEED * fastest:
        return None
    given, taken = float((before_i - after_i) @ line), float((after_j - before_j) @ line)
    if given <= 0 or taken <= 0:
        return None
    return Collision(i, j, time, float(np.clip(separation / approach, 0, 1)), given / taken)


def _velocity(arcs: Sequence[Arc], time: float, before: bool) -> np.ndarray | None:
    """Velocity (2,) px/s at a time, by the last arc that is mostly before it, or the first that is mostly after it."""
    near = [a for a in arcs if (a.time < time) == before]
    if not near:
        return None
    arc = near[-1] if before else near[0]
    return arc.velocity_at(time)


def _place(track: ImageTrack, time: float) -> np.ndarray:
    return np.asarray(track.centre[int(np.argmin(np.abs(track.times - time)))])
