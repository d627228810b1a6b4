"""What happens in a clip, from its trace and masks: who comes into view, slides, rolls, stops, hits whom, when.

Thresholds are physical (m/s, s, px of 480x320). Regimes of contact with the ground, or with a fixed body that supports
the object, at every step: an object on it rests where nothing moves, slides where the contact points move faster than
`slip_speed`, rolls (round bodies, cylinders on their side) where they do not but the centre moves, and else tumbles;
off the ground it flies. What happens out of view is left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.physics.trace import FIRST_FIXED, GROUND, Trace
from pipeline.scene.rotation import matrix_from_quaternion

ROUND_SHAPES = ("sphere", "cylinder", "capsule", "ellipsoid")
AIR, SLIDE, ROLL, REST, TUMBLE = range(5)
#: Slip over the speed of the centre: 1 of a body that slides, 0 of one that rolls. Above the one share it slides,
#: however slow it is; below the other it rolls, however fast: soft contacts creep.
SLIDING_SHARE, ROLLING_SHARE = 0.5, 0.1
CLEARLY = 1.25  # times as much slip after a start of sliding as before it, or less after one of rolling
CHANGES: dict[tuple[int, int], str] = {
    (SLIDE, REST): "stops_sliding",
    (ROLL, REST): "stops_rolling",
    (SLIDE, ROLL): "starts_rolling",
    (REST, ROLL): "starts_rolling",
    (ROLL, SLIDE): "starts_sliding",
    (REST, SLIDE): "starts_sliding",
}
LYING = 0.35  # sine of how far a cylinder's axis may be from level where it lies on its side
LEVEL = 0.9  # of the speed is along the ground where a body rolls and does not fall
SUPPORT = 0.5  # upward part of the normal of a contact with a fixed body above which that supports the object
PUSH = 0.02  # s from a touch on, within which a hit pushes
LEVER = 0.1  # m; turning is rest where points at this distance move slower than `moving_speed`

KINDS = (
    "hits_object",
    "hits_ground",
    "hits_fixed",
    "enters",
    "leaves",
    "starts_rolling",
    "stops_rolling",
    "starts_sliding",
    "stops_sliding",
)
#: Those that an answer can have: it has no fixed bodies.
ANSWERED_KINDS = tuple(kind for kind in KINDS if kind != "hits_fixed")


@dataclass(frozen=True)
class Event:
    """time: s. first: the object; second: the other object of `hits_object`, the fixed body of `hits_fixed`, else None.

    Indices from 0.
    """

    time: float
    kind: str
    first: int
    second: int | None = None

    @property
    def objects(self) -> tuple[int, ...]:
        """The objects that take part."""
        return (self.first,) if self.second is None or self.kind == "hits_fixed" else (self.first, self.second)


def event_of_row(row: Mapping[str, Any]) -> Event:
    """The event in a row of the table `events`, where `second` is -1 for none."""
    return Event(row["time"], row["kind"], row["first"], None if row["second"] < 0 else row["second"])


@dataclass(frozen=True)
class Thresholds:
    """From which values on something is an event.

    Attributes:
        impact_speed: Approach along the normal, m/s, below which a touch is no hit.
        separation: s without contact before a touch counts as new and the body as having flown.
        slip_speed: Of a contact point, m/s, above which a body slides.
        moving_speed: m/s, below which a body rests.
        duration: s that a regime has to last.
        visible_px: Area, px of 480x320, from which an object is in view.
        most: Events kept, the first ones.
    """

    impact_speed: float
    separation: float
    slip_speed: float
    moving_speed: float
    duration: float
    visible_px: float
    most: int


#: Outside the graph, which has its own in params.yaml (`events`, `sample.filters.visible_px`; a test compares them).
DEFAULT_THRESHOLDS = Thresholds(
    impact_speed=0.2, separation=0.1, slip_speed=0.05, moving_speed=0.03, duration=0.1, visible_px=32.0, most=12
)


def find_events(
    trace: Trace, shapes: tuple[str, ...], areas_px: np.ndarray, frame_steps: np.ndarray, thresholds: Thresholds
) -> list[Event]:
    """The clip's events in the order of time, at most `thresholds.most`.

    areas_px: (F, N) area of each object in each frame, px of 480x320. frame_steps: (F,) step of each frame.
    """
    return told_events(physical_events(trace, shapes, thresholds), areas_px, frame_steps / trace.rate, thresholds)


def physical_events(trace: Trace, shapes: tuple[str, ...], thresholds: Thresholds) -> list[Event]:
    """Hits and changes of motion, seen or not."""
    return [*collisions(trace, thresholds), *motion_changes(trace, shapes, thresholds)]


def told_events(physical: list[Event], areas_px: np.ndarray, times: np.ndarray, thresholds: Thresholds) -> list[Event]:
    """The events of `find_events`, from those of `physical_events` and what a camera sees.

    areas_px: (F, N) area of each object in each frame, px of 480x320. times: (F,) of the frames, s.
    """
    seen = areas_px >= thresholds.visible_px
    events = [*visibility(areas_px, times, thresholds), *(e for e in physical if _in_view(e, seen, times))]
    events.sort(key=lambda e: (round(e.time, 2), e.first, KINDS.index(e.kind), -1 if e.second is None else e.second))
    return _without_repeats(events)[: thresholds.most]


def _in_view(event: Event, seen: np.ndarray, times: np.ndarray) -> bool:
    """Whether one of the event's objects is seen in the frame before it or the frame after; seen: (F, N)."""
    after = np.searchsorted(times, event.time)
    around = seen[max(after - 1, 0) : after + 1]
    return bool(around[:, list(event.objects)].any())


def collisions(trace: Trace, thresholds: Thresholds) -> list[Event]:
    """Hits of all three kinds: first touches with an approach speed of at least `impact_speed`."""
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
            touch = rows[(c.step[rows] >= step) & (c.step[rows] < step + PUSH * trace.rate)]
            pushed = np.abs(c.force[touch]).max() > 0  # bodies that only graze each other's margin do not
            if pushed and approach[rows[c.step[rows] == step]].max() >= thresholds.impact_speed:
                events.append(_hit(float(step / trace.rate), first, second))
    return events


def _hit(time: float, first: int, second: int) -> Event:
    """The event of a hit; first, second: as in contacts."""
    if second >= 0:
        return Event(time, "hits_object", min(first, second), max(first, second))
    return (
        Event(time, "hits_ground", first)
        if second == GROUND
        else Event(time, "hits_fixed", first, FIRST_FIXED - second)
    )


def point_velocity(trace: Trace, step: np.ndarray, body: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Velocity (C, 3), m/s, of points (C, 3) that move with the bodies (C,) at the steps (C,).

    That of the ground and of fixed bodies is 0.
    """
    own = np.maximum(body, GROUND)
    arm = point - trace.position[step, own]
    velocity = trace.velocity[step, own] + np.cross(trace.angular_velocity[step, own], arm)
    return np.where((body <= GROUND)[:, None], 0.0, velocity)


def visibility(areas_px: np.ndarray, times: np.ndarray, thresholds: Thresholds) -> list[Event]:
    """`enters` and `leaves`: changes of view that last two frames or more, at the first frame of the new state."""
    events = []
    for i in range(areas_px.shape[1]):
        seen = _settled((areas_px[:, i] >= thresholds.visible_px).astype(int), 2)
        for frame in np.flatnonzero(np.diff(seen)) + 1:
            events.append(Event(float(times[frame]), "enters" if seen[frame] else "leaves", i))
    return events


def regimes(trace: Trace, shapes: tuple[str, ...], thresholds: Thresholds) -> np.ndarray:
    """(S, N) regime of each object from each step to the next, brief ones merged into what came before."""
    steps, duration = len(trace.position) - 1, round(thresholds.duration * trace.rate)
    normals = support_normals(trace)[:-1]
    speed, turning = (np.linalg.norm(v[:-1], axis=-1) for v in (trace.velocity, trace.angular_velocity))
    still = (speed < thresholds.moving_speed) & (turning < thresholds.moving_speed / LEVER)
    out = np.full((steps, len(shapes)), AIR)
    for i, shape in enumerate(shapes):
        along = speed_along(trace.velocity[:-1, i], normals[:, i])
        grounded, slip = ground_contact(trace, i, thresholds)
        creep = np.maximum(thresholds.slip_speed, ROLLING_SHARE * along)
        glides = slip > SLIDING_SHARE * np.maximum(speed[:, i], LEVER * turning[:, i])
        slides = _latched((slip > 2 * creep) | glides, (slip < creep) & ~glides)
        travels = (along >= thresholds.moving_speed) & (along > LEVEL * speed[:, i])
        without_slip = np.where(may_roll(trace, i, shape, normals[:, i]) & travels, ROLL, TUMBLE)
        regime = np.where(still[:, i], REST, np.where(slides, SLIDE, without_slip))
        out[:, i] = _settled(np.where(grounded, regime, AIR), duration)
    return out


def supporting(trace: Trace) -> np.ndarray:
    """(C,) whether a contact is with the ground, or with a fixed body below the object."""
    c = trace.contacts
    return (c.second == GROUND) | ((c.second <= FIRST_FIXED) & (c.normal[:, 2] > SUPPORT))


def support_normals(trace: Trace) -> np.ndarray:
    """(S + 1, N, 3) normal of what each object stands on: that of the last contact at or before each time, else z."""
    steps, objects = trace.position.shape[:2]
    out = np.tile([0.0, 0.0, 1.0], (steps, objects, 1))
    c = trace.contacts
    rows = supporting(trace)
    if not (c.second[rows] <= FIRST_FIXED).any():
        return out
    for i in range(objects):
        mine = rows & (c.first == i)
        total = np.zeros((steps, 3))
        np.add.at(total, c.step[mine], c.normal[mine])
        touched = np.unique(c.step[mine])
        if len(touched):
            last = touched[np.maximum(np.searchsorted(touched, np.arange(steps), "right") - 1, 0)]
            out[:, i] = total[last] / np.linalg.norm(total[last], axis=1, keepdims=True)
    return out


def speed_along(velocity: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Speed (T,) along a surface, m/s, from velocities (T, 3) m/s and normals (T, 3)."""
    return np.linalg.norm(velocity - np.sum(velocity * normal, 1, keepdims=True) * normal, axis=1)


def ground_slips(trace: Trace, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps (C,) of the object's contact points on the ground or a support, and how fast each slips, (C,) m/s."""
    c = trace.contacts
    rows = np.flatnonzero(supporting(trace) & (c.first == index))
    moving = point_velocity(trace, c.step[rows], c.first[rows], c.position[rows])
    along = moving - np.sum(moving * c.normal[rows], 1, keepdims=True) * c.normal[rows]
    return c.step[rows], np.linalg.norm(along, axis=1)


def ground_contact(trace: Trace, index: int, thresholds: Thresholds) -> tuple[np.ndarray, np.ndarray]:
    """(S,) whether the object stands on something, hops shorter than `separation` included, and (S,) its slip, m/s.

    The slip is that of its contact points in the mean over the last half of `duration`, so that a body that chatters
    over the ground slides as one that glides does.
    """
    steps = len(trace.position) - 1
    at, slips = ground_slips(trace, index)
    if not len(at):
        return np.zeros(steps, bool), np.zeros(steps)
    window = np.ones(max(round(thresholds.duration / 2 * trace.rate), 1))
    number, total = (
        np.convolve(np.bincount(at, weights, steps), window)[:steps] for weights in (np.ones(len(at)), slips)
    )
    near = np.flatnonzero(number > 0.5)
    slip = np.interp(np.arange(steps), near, total[near] / number[near])
    touched = np.unique(at)
    gap = round(thresholds.separation * trace.rate)
    grounded = np.zeros(steps, bool)
    for before, after in itertools.pairwise([-1, *touched, steps]):
        grounded[after : after + 1] = True
        if after - before - 1 <= gap:
            grounded[before + 1 : after] = True
    return grounded, slip


def may_roll(trace: Trace, index: int, shape: str, normal: np.ndarray) -> np.ndarray | bool:
    """Whether the object can roll, (S,) for a cylinder, which can where it lies on its side.

    normal: (S, 3), of what it lies on.
    """
    if shape == "cylinder":
        axis = matrix_from_quaternion(trace.quaternion[:-1, index])[..., 2]
        return np.abs(np.sum(axis * normal, 1)) < LYING
    return shape in ROUND_SHAPES


def motion_changes(trace: Trace, shapes: tuple[str, ...], thresholds: Thresholds) -> list[Event]:
    """Starts and stops of rolling and sliding on the ground; landing, take-off and tumbling are no such change."""
    events = []
    table, normals = regimes(trace, shapes, thresholds), support_normals(trace)
    for i in range(len(shapes)):
        for step in np.flatnonzero(np.diff(table[:, i])) + 1:
            kind = CHANGES.get((int(table[step - 1, i]), int(table[step, i])))
            if kind is not None and _borne_out(trace, normals, i, kind, int(step), thresholds):
                events.append(Event(float(step / trace.rate), kind, i))
    return events


def _borne_out(trace: Trace, normals: np.ndarray, index: int, kind: str, step: int, thresholds: Thresholds) -> bool:
    """Whether the contacts confirm that a motion starts or stops at a step.

    Before a stop and after a start, the contacts slip where the object slides, and hold where it rolls; a start also
    has to change the slip.

    Args:
        trace: Of all objects.
        normals: (S + 1, N, 3), of what objects stand on.
        index: The object.
        kind: Of the event.
        step: At which it is.
        thresholds: `duration` is how long contacts are looked at, at most until the object is hit.
    """
    c, duration = trace.contacts, round(thresholds.duration * trace.rate)
    hit = c.step[((c.first == index) | (c.second == index)) & (c.second >= 0) & (c.step > step + duration // 4)]
    at, slips = ground_slips(trace, index)
    before = slips[(at >= step - duration) & (at < step)]
    after = slips[(at >= step) & (at < min(step + duration, hit.min(initial=step + duration)))]
    begin = step if kind.startswith("starts") else max(step - duration, 0)
    shown = slice(begin, begin + duration)
    along = speed_along(trace.velocity[shown, index], normals[shown, index]).mean()
    creep = max(thresholds.slip_speed, ROLLING_SHARE * along)
    if kind == "stops_rolling":
        return len(before) > 0 and before.mean() < 2 * creep
    if kind == "stops_sliding":
        speed = np.linalg.norm(trace.velocity[shown, index], axis=-1).mean()
        turning = np.linalg.norm(trace.angular_velocity[shown, index], axis=-1).mean()
        return len(before) > 0 and before.max() > creep and before.mean() > ROLLING_SHARE * max(speed, LEVER * turning)
    if not len(after):
        return False
    earlier = before.mean() if len(before) else 0.0
    if kind == "starts_rolling":
        slipped = earlier > thresholds.slip_speed
        most = earlier / CLEARLY if slipped else np.inf
        return after.mean() < min(2 * creep, SLIDING_SHARE * along, most)
    lasting = after[len(after) // 2 :]  # a slip that dies at once is none
    return min(after.mean(), lasting.mean()) > max(creep, CLEARLY * earlier)


def _without_repeats(events: list[Event]) -> list[Event]:
    """The events without repeated ones: starts of a motion that goes on already, and stops of one that does not.

    After a hit, an event counts as new.
    """
    doing: dict[int, str] = {}
    kept = []
    for event in events:
        verb, _, motion = event.kind.partition("_")
        if verb == "hits":
            for index in event.objects:
                doing.pop(index, None)
        elif verb in ("starts", "stops"):
            last = doing.get(event.first)
            if (verb == "starts" and last == motion) or (verb == "stops" and last not in (None, motion)):
                continue
            doing[event.first] = motion if verb == "starts" else "resting"
        kept.append(event)
    return kept


def _latched(on: np.ndarray, off: np.ndarray) -> np.ndarray:
    """(T,) True from each `on` to the next `off`; before the first of them, True unless it is an `off`."""
    switches = np.flatnonzero(on | off)
    if not len(switches):
        return np.ones(len(on), bool)
    return on[switches][np.maximum(np.searchsorted(switches, np.arange(len(on)), "right") - 1, 0)]


@dataclass
class _Run:
    """Consecutive steps in one state, from `start`; `own` of them were in it before brief states were merged."""

    state: int
    start: int
    own: int


def _settled(states: np.ndarray, length: int) -> np.ndarray:
    """(T,) the states without those that last less than `length`; the first state stays.

    A brief state between two equal ones becomes that, the shortest first. What is brief then becomes what was before;
    or rest where that comes within half of `length` (a body wobbles before it rests); or nothing definite, `TUMBLE`,
    where one brief state follows another for `length` or longer.
    """
    cuts = [0, *(np.flatnonzero(np.diff(states)) + 1), len(states)]
    runs = [_Run(int(states[a]), int(a), int(b - a)) for a, b in itertools.pairwise(cuts) if b > a]
    while between := [
        k for k in range(1, len(runs) - 1) if runs[k].own < length and runs[k - 1].state == runs[k + 1].state
    ]:
        k = min(between, key=lambda k: runs[k].own)
        runs[k - 1].own += runs[k + 1].own
        del runs[k : k + 2]
    out = states.copy()
    lasting = [k for k, run in enumerate(runs) if k == 0 or run.own >= length]
    for k, following in itertools.pairwise([*lasting, len(runs)]):
        ends = runs[k + 1].start if k + 1 < len(runs) else len(states)
        stop = runs[following].start if following < len(runs) else len(states)
        out[runs[k].start : ends] = runs[k].state
        if stop - ends >= length:
            out[ends:stop] = TUMBLE
        else:
            rests = following < len(runs) and runs[following].state == REST and 2 * (stop - ends) <= length
            out[ends:stop] = REST if rests else runs[k].state
    return out
