"""What happens in a clip, from its trace and masks: who comes into view, slides, rolls, stops, hits whom, when.

Thresholds are physical (m/s, s, px of 480x320). Regimes of contact with the ground, at every step: an object
that touches it slides where the contact point moves faster than `slip_speed`, rolls (round bodies) where it does
not but the centre moves, and rests where nothing moves; else it flies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.physics.trace import GROUND, Trace

ROUND_SHAPES = ("sphere", "cylinder", "capsule", "ellipsoid")
AIR, SLIDE, ROLL, REST, TUMBLE = range(5)

KINDS = (
    "hits_object", "hits_ground", "enters", "leaves",
    "starts_rolling", "stops_rolling", "starts_sliding", "stops_sliding",
)  # fmt: skip


@dataclass(frozen=True)
class Event:
    """time: s. first: the object; second: the other object of `hits_object`, else None. Indices from 0."""

    time: float
    kind: str
    first: int
    second: int | None = None


@dataclass(frozen=True)
class Thresholds:
    """impact_speed: approach along the normal, m/s, below which a touch is no hit. separation: s without contact
    before a touch counts as new. slip_speed, moving_speed: m/s. duration: s that a regime has to last.
    visible_px: area, px of 480x320, from which an object is in view. most: events kept, the earliest first."""

    impact_speed: float = 0.2
    separation: float = 0.05
    slip_speed: float = 0.05
    moving_speed: float = 0.03
    duration: float = 0.05
    visible_px: float = 32.0
    most: int = 12


def find_events(
    trace: Trace, shapes: tuple[str, ...], areas_px: np.ndarray, frame_steps: np.ndarray, thresholds: Thresholds
) -> list[Event]:
    """The clip's events in the order of time, at most `thresholds.most`.

    areas_px: (F, N) area of each object in each frame, px of 480x320. frame_steps: (F,) step of each frame.
    """
    events = [
        *collisions(trace, thresholds),
        *visibility(areas_px, frame_steps / trace.rate, thresholds),
        *motion_changes(trace, shapes, thresholds),
    ]
    events.sort(key=lambda e: (round(e.time, 2), e.first, KINDS.index(e.kind), -1 if e.second is None else e.second))
    return events[: thresholds.most]


def collisions(trace: Trace, thresholds: Thresholds) -> list[Event]:
    """`hits_object` and `hits_ground`: first touches with an approach speed of at least `impact_speed`."""
    c = trace.contacts
    events = []
    gap = round(thresholds.separation * trace.rate)
    approach = -np.sum(point_velocity(trace, c.step, c.first, c.position) * c.normal, 1)
    approach += np.sum(point_velocity(trace, c.step, c.second, c.position) * c.normal, 1)
    for first, second in sorted({(int(a), int(b)) for a, b in zip(c.first, c.second, strict=True)}):
        rows = np.flatnonzero((c.first == first) & (c.second == second))
        steps = np.unique(c.step[rows])
        starts = steps[np.diff(steps, prepend=-gap - 2) > gap]
        for step in starts:
            # the first contact point may open an impact that a later point of the same touch completes
            touch = rows[(c.step[rows] >= step) & (c.step[rows] < step + max(gap // 2, 1))]
            if approach[touch].max() >= thresholds.impact_speed:
                kind = "hits_ground" if second == GROUND else "hits_object"
                a, b = (first, None) if second == GROUND else (min(first, second), max(first, second))
                events.append(Event(float(step / trace.rate), kind, a, b))
    return events


def point_velocity(trace: Trace, step: np.ndarray, body: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Velocity (C, 3), m/s, of the points (C, 3) that move with the bodies (C,) at the steps (C,); the ground's is 0."""
    arm = point - trace.position[step, body]
    velocity = trace.velocity[step, body] + np.cross(trace.angular_velocity[step, body], arm)
    return np.where((body == GROUND)[:, None], 0.0, velocity)


def visibility(areas_px: np.ndarray, times: np.ndarray, thresholds: Thresholds) -> list[Event]:
    """`enters` and `leaves`: changes of view that last two frames or more, at the first frame of the new state."""
    events = []
    for i in range(areas_px.shape[1]):
        seen = _settled(areas_px[:, i] >= thresholds.visible_px, 2)
        for frame in np.flatnonzero(np.diff(seen.astype(int))) + 1:
            events.append(Event(float(times[frame]), "enters" if seen[frame] else "leaves", i))
    return events


def regimes(trace: Trace, shapes: tuple[str, ...], thresholds: Thresholds) -> np.ndarray:
    """(S, N) regime of each object from each step to the next, brief ones merged into what came before."""
    c, steps = trace.contacts, len(trace.position) - 1
    speed = np.linalg.norm(trace.velocity[:-1], axis=-1)
    turning = np.linalg.norm(trace.angular_velocity[:-1], axis=-1)
    slip = np.full((steps, len(shapes)), np.inf)
    ground = c.second == GROUND
    moving = point_velocity(trace, c.step, c.first, c.position)
    along = moving - np.sum(moving * c.normal, 1, keepdims=True) * c.normal
    np.minimum.at(slip, (c.step[ground], c.first[ground]), np.linalg.norm(along[ground], axis=1))
    touching = np.isfinite(slip)
    out = np.full((steps, len(shapes)), AIR)
    for i, shape in enumerate(shapes):
        still = (speed[:, i] < thresholds.moving_speed) & (turning[:, i] < 10 * thresholds.moving_speed)
        without_slip = ROLL if shape in ROUND_SHAPES else TUMBLE
        regime = np.where(slip[:, i] > thresholds.slip_speed, SLIDE, np.where(still, REST, without_slip))
        regime = np.where(touching[:, i], regime, AIR)
        out[:, i] = _settled(regime, round(thresholds.duration * trace.rate))
    return out


def motion_changes(trace: Trace, shapes: tuple[str, ...], thresholds: Thresholds) -> list[Event]:
    """Starts and stops of rolling and sliding on the ground; landing and take-off are no such change."""
    events = []
    table = regimes(trace, shapes, thresholds)
    for i in range(len(shapes)):
        for step in np.flatnonzero(np.diff(table[:, i])) + 1:
            before, after = table[step - 1, i], table[step, i]
            time = float(step / trace.rate)
            if before in (SLIDE, ROLL) and after == REST:
                events.append(Event(time, "stops_sliding" if before == SLIDE else "stops_rolling", i))
            elif before == SLIDE and after == ROLL:
                events.append(Event(time, "starts_rolling", i))
            elif before == ROLL and after == SLIDE:
                events.append(Event(time, "starts_sliding", i))
    return events


def _settled(states: np.ndarray, length: int) -> np.ndarray:
    """(T,) the states with every run shorter than `length` replaced by the state before it (the first run stays)."""
    out = states.copy()
    starts = np.flatnonzero(np.diff(states, prepend=states[:1])) if len(states) else []
    bounds = [0, *[s for s in starts if s], len(states)]
    for a, b in zip(bounds[1:-1], bounds[2:], strict=True):
        if b - a < length:
            out[a:b] = out[a - 1]
    return out
