"""What bodies rest on, slide along and bounce off: found from their tracks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc
from pipeline.worlds.blocks import Block, at_block
from pipeline.worlds.bounces import bounce_between
from pipeline.worlds.view import ArcMotion, View, down, mean_slope

MARGIN = 4.0  # radii that a support goes on beyond what is seen of the motion along it
NEAR = 1.5  # sums of radii within which two bodies may have hit each other
LEAST_PATH = 1.0  # radii of a way along a support


@dataclass(frozen=True)
class Support:
    """A straight edge in the picture that carries bodies, or off which they bounce.

    Attributes:
        start: (2,) px, where it begins.
        stop: (2,) px, where it ends; the body of the support is on the right of the way from start to stop as the
            picture is seen (below it, where stop is to the right of start).
        restitution: Normal speed after the bounce over that before; None where nothing bounced.
    """

    start: np.ndarray
    stop: np.ndarray
    restitution: float | None = None

    @property
    def along(self) -> np.ndarray:
        """(2,) unit vector from start to stop."""
        way = self.stop - self.start
        return np.asarray(way / np.linalg.norm(way))

    @property
    def into(self) -> np.ndarray:
        """(2,) unit normal, into the support."""
        x, y = self.along
        return np.array([-y, x])


def reach(track: ImageTrack, masks: np.ndarray, direction: np.ndarray) -> float:
    """px from a body's centre to its outline's furthest pixel in a direction (2,), median over whole outlines."""
    values = []
    for k in np.flatnonzero(track.whole)[:: max(1, int(track.whole.sum()) // 12)]:
        rows, cols = np.nonzero(masks[track.frames[k]] == track.body)
        points = np.stack([cols + 0.5, rows + 0.5], 1) - track.centre[k]
        values.append(float((points @ direction).max()) + 0.5)
    return float(np.median(values)) if values else track.radius


def find_supports(
    view: View,
    tracks: Sequence[ImageTrack],
    flat: Sequence[ImageTrack],
    masks: np.ndarray,
    blocks: Sequence[Block] = (),
) -> list[Support]:
    """The supports that the tracks of a side view tell of: what bodies move along, then what they bounce off.

    Args:
        view: Of the clip.
        tracks: Of its bodies.
        flat: The same in the picture of the plane, where supports are sought.
        masks: (T, H, W) ids.
        blocks: Fixed bodies that are known: there is no other support where a body bounces off them.
    """
    seen, by_body = ({t.body: t for t in some} for some in (tracks, flat))

    def reaches(track: ImageTrack, into: np.ndarray) -> float:
        own = seen[track.body]
        return reach(own, masks, into) * track.radius / own.radius

    if view.kind == "top":
        return find_walls(view, flat, blocks)
    carried = _ways(view, by_body)
    supports = []
    for group in carried:
        arcs = [m.arc for m in group]
        slope = np.radians(view.roll_deg + mean_slope(group))
        along = np.array([np.cos(slope), np.sin(slope)])
        into = np.array([-along[1], along[0]])
        offsets, low, high = [], np.inf, -np.inf
        for arc in arcs:
            track = by_body[arc.body]
            use = np.arange(arc.start, arc.stop)
            use = use[track.whole[use]]
            offsets.append(track.centre[use] @ into + reaches(track, into))
            places = track.centre[use] @ along
            margin = MARGIN * track.radius
            ends = _ends(view, arc, along)
            low = min(low, places.min() - (0 if ends[0] else margin))
            high = max(high, places.max() + (0 if ends[1] else margin))
        offset = float(np.median(np.concatenate(offsets)))
        supports.append(Support(offset * into + low * along, offset * into + high * along))
    return _with_bounces(view, by_body, reaches, supports, blocks)


def find_walls(view: View, tracks: Sequence[ImageTrack], blocks: Sequence[Block] = ()) -> list[Support]:
    """What bodies bounce off on level ground that is seen from above, beside the blocks."""
    return _with_bounces(view, {t.body: t for t in tracks}, lambda track, _: track.radius, [], blocks)


def _ways(view: View, tracks: dict[int, ImageTrack]) -> list[list[ArcMotion]]:
    """Arcs along supports; those of one support together: all that slope do so alike, the others are level."""
    groups: list[list[ArcMotion]] = []
    for motion in view.arcs:
        if motion.kind not in ("slope", "straight"):
            continue
        into, radius = down(view.roll_deg + motion.slope_deg), tracks[motion.arc.body].radius
        for group in groups:
            first = group[0]
            if first.kind == motion.kind and abs((first.arc.position - motion.arc.position) @ into) < radius:
                group.append(motion)
                break
        else:
            groups.append([motion])
    return groups


def _ends(view: View, arc: Arc, along: np.ndarray) -> tuple[bool, bool]:
    """Whether a support ends where the arc begins, and where it stops: the body falls before, or after."""
    own = [m for m in view.arcs if m.arc.body == arc.body]
    place = next(i for i, m in enumerate(own) if m.arc is arc)
    before = place > 0 and own[place - 1].kind == "free"
    after = place + 1 < len(own) and own[place + 1].kind == "free"
    forward = arc.velocity @ along > 0
    return (before, after) if forward else (after, before)


def _with_bounces(
    view: View,
    tracks: dict[int, ImageTrack],
    reach_of: Callable[[ImageTrack, np.ndarray], float],
    carried: Sequence[Support],
    blocks: Sequence[Block],
) -> list[Support]:
    """The supports, and those where the velocity of a body jumps and no other body is near.

    A support that is known is made longer where a body bounces off its line.
    """
    found = list(carried)
    motions = list(view.arcs)
    across = [sign * s.along for s in carried for sign in (1, -1)]
    for first, second in itertools.pairwise(motions):
        a, b = first.arc, second.arc
        if a.body != b.body:
            continue
        track = tracks[a.body]
        bounce = bounce_between(track, a, b, across)
        if bounce is None or _other_near(tracks, track, bounce.place, bounce.time):
            continue
        into = bounce.into
        along = np.array([into[1], -into[0]])
        contact = bounce.place + reach_of(track, into) * into
        if at_block(blocks, contact, track.radius):
            continue
        half = MARGIN * track.radius
        for k, known in enumerate(found):
            if abs((contact - known.start) @ known.into) < track.radius and known.into @ into > 0.9:
                found[k] = _longer(known, contact, half)
                break
        else:
            found.append(Support(contact - half * along, contact + half * along, bounce.restitution))
    return found


def _longer(support: Support, contact: np.ndarray, half: float) -> Support:
    """A support that goes on for `half` px beyond a contact (2,) px; one that holds the contact stays as it is."""
    place, length = (contact - support.start) @ support.along, np.linalg.norm(support.stop - support.start)
    low, high = min(0.0, place - half), max(length, place + half)
    if support.restitution is None and 0 <= place <= length:
        low, high = 0.0, length
    return replace(support, start=support.start + low * support.along, stop=support.start + high * support.along)


def _other_near(tracks: dict[int, ImageTrack], own: ImageTrack, place: np.ndarray, time: float) -> bool:
    for track in tracks.values():
        if track.body == own.body:
            continue
        k = int(np.argmin(np.abs(track.times - time)))
        if np.linalg.norm(track.centre[k] - place) < NEAR * (track.radius + own.radius):
            return True
    return False
