"""Bounces of one body off something that does not move: where the velocity of its track turns back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc

SIGNIFICANT = 4.0  # standard errors from which a jump of the velocity counts
SNAP_DEG = 30.0  # a surface that a body bounces off is level or upright if it is within this
LEAST_JUMP = 0.15  # of the speed: change of velocity that is a bounce
LEAST_NORMAL = 0.1  # of the speed, that is normal to the surface
MOST_RESTITUTION = 1.1  # more is no bounce off a body at rest
LEVEL_AND_UPRIGHT = ([0.0, -1.0], [0.0, 1.0], [1.0, 0.0], [-1.0, 0.0])


@dataclass(frozen=True)
class Bounce:
    """A body's bounce: time, s; place (2,) px of its centre; unit normal `into` (2,) the surface; restitution."""

    time: float
    place: np.ndarray
    into: np.ndarray
    restitution: float


def bounce_between(track: ImageTrack, a: Arc, b: Arc, likely: Sequence[np.ndarray] = ()) -> Bounce | None:
    """The bounce between two arcs of a track, one after the other; None where the velocity does not turn back.

    likely: Unit normals (2,) that a surface has if it is within SNAP_DEG of one; else level and upright ones count.
    """
    if not changes_between(track, a, b):
        return None
    time = meeting_time(track, a, b)
    before, after = a.velocity_at(time), b.velocity_at(time)
    jump = after - before
    speed = max(float(np.linalg.norm(before)), float(np.linalg.norm(after)))
    away = jump / np.linalg.norm(jump)
    for normal in (*likely, *LEVEL_AND_UPRIGHT):
        if away @ normal > np.cos(np.radians(SNAP_DEG)):
            away = np.asarray(normal)
            break
    incoming, outgoing = -float(before @ away), float(after @ away)
    if incoming <= LEAST_NORMAL * speed or not 0 <= outgoing <= incoming * MOST_RESTITUTION:
        return None
    place = 0.5 * (a.position_at(np.array([time])) + b.position_at(np.array([time])))[0]
    return Bounce(time, place, -away, min(outgoing / incoming, 1.0))


def changes_between(track: ImageTrack, a: Arc, b: Arc) -> bool:
    """Whether the velocity jumps between two arcs of a track, one after the other."""
    time = meeting_time(track, a, b)
    before, after = a.velocity_at(time), b.velocity_at(time)
    speed = max(float(np.linalg.norm(before)), float(np.linalg.norm(after)))
    error = SIGNIFICANT * float(np.hypot(_edge_sigma(a, time), _edge_sigma(b, time)))
    return float(np.linalg.norm(after - before)) > max(LEAST_JUMP * speed, error)


def _edge_sigma(arc: Arc, time: float) -> float:
    """px/s: standard error of an arc's velocity at a time, s."""
    t = time - arc.time
    c = arc.covariance
    return float(np.sqrt(max(c[1, 1] + 2 * t * c[1, 2] + t**2 * c[2, 2] * bool(arc.acceleration.any()), 0.0)))


def meeting_time(track: ImageTrack, a: Arc, b: Arc) -> float:
    """The time, s, at which two arcs are nearest to each other, near the gap between them."""
    low, high = track.times[a.stop - 1], track.times[b.start]
    extra = 0.5 * (high - low)
    times = np.linspace(low - extra, high + extra, 60)
    apart = np.linalg.norm(a.position_at(times) - b.position_at(times), axis=1)
    return float(times[int(np.argmin(apart))])
