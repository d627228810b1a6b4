"""Joins of tracks: one that goes on where another ended, two parts of one body, two ends of one rigid body."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.tracks.hull import convex_hull

LONGEST_GAP = 10  # frames
SHORTEST = 2  # frames; what is seen for less is noise
END_FRAMES = 5  # that give a track's velocity at an end
MOST_APART, MOST_COST = 1.6, 3.0  # in radii; with colour and size
NEAR_COLOUR, NEAR_SIZE = 0.2, 0.6  # differences of colour in [0, 1] and of log radius that cost 1
TOGETHER = 0.6  # radii; half of it where colours differ by more than NEAR_COLOUR
PART_APART, PART_TOUCH = 1.25, 0.5  # radii between parts of one body; share of the frames in which they touch
MOSTLY = 80  # percent of the frames
PART_FILLS, BODY_FILLS = 1.0, 1.6  # most area of a part and of both, in discs of the radius that the network says
LEAST_COMMON = 5  # frames in which two ends of a rigid body are seen together
STIFF = 0.1, 0.7  # most deviation of the vector between the ends: share of their radii, and px
LEAST_BRIDGE = 0.15  # mean probability, of a moving body, between the ends


def joined(tracks: list[Track], probability: np.ndarray) -> list[Track]:
    """The tracks with those of one body made one. probability: (T, H, W) that a pixel shows a moving body."""
    width = probability.shape[2]
    whole = _together(_continued([t for t in tracks if len(t.pieces) >= SHORTEST]), width)
    return _together(_continued(_stiff(whole, probability)), width)


def _end(track: Track, late: bool) -> tuple[int, np.ndarray, np.ndarray]:
    """Frame, centre (2,) px and velocity (2,) px a frame at a track's end or beginning."""
    times = sorted(track.pieces)
    times = times[-END_FRAMES:] if late else times[:END_FRAMES]
    centres = np.array([track.pieces[t].centre for t in times])
    velocity = np.polyfit(np.array(times, float), centres, 1)[0] if len(times) > 2 else np.zeros(2)
    k = -1 if late else 0
    return times[k], centres[k], velocity


def typical_colour(track: Track) -> np.ndarray:
    return np.asarray(np.median([p.colour for p in track.pieces.values()], axis=0))


def _one_colour(one: Track, other: Track) -> bool:
    return bool(np.abs(typical_colour(one) - typical_colour(other)).max() < NEAR_COLOUR)


def continuation_cost(before: Track, after: Track) -> float:
    """What it costs to take two tracks for one body that was not seen in between; inf where it cannot be."""
    end, last, leaving = _end(before, late=True)
    start, first, coming = _end(after, late=False)
    gap = start - end
    if not 0 < gap <= LONGEST_GAP:
        return np.inf
    radii = before.typical_radius, after.typical_radius
    missed = min(np.linalg.norm(last + gap * leaving - first), np.linalg.norm(first - gap * coming - last))
    apart = float(missed) / (max(radii) + 2)
    if apart >= MOST_APART:
        return np.inf
    colour = np.abs(typical_colour(before) - typical_colour(after)).max() / NEAR_COLOUR
    cost = apart + colour + abs(np.log(radii[0] / radii[1])) / NEAR_SIZE
    return float(cost) if cost < MOST_COST else np.inf


def _continued(tracks: list[Track]) -> list[Track]:
    """The tracks, of which one that goes on where another ended is joined to it, the cheapest first."""
    tracks = list(tracks)
    while len(tracks) > 1:
        cost = np.array([[continuation_cost(a, b) if a is not b else np.inf for b in tracks] for a in tracks])
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        if not np.isfinite(cost[i, j]):
            break
        tracks[i].pieces.update(tracks[j].pieces)
        del tracks[j]
    return tracks


def _together(tracks: list[Track], width: int) -> list[Track]:
    """The tracks, of which two whose centres stay together, or that are parts of one body, are one. width: px."""
    tracks = sorted(tracks, key=lambda k: -sum(len(p.pixels) for p in k.pieces.values()))
    out: list[Track] = []
    for track in tracks:
        host = next((k for k in out if _stay_together(k, track) or _parts_of_one(k, track, width)), None)
        if host is None:
            out.append(track)
            continue
        for t, piece in track.pieces.items():
            host.add(t, piece)
    return out


def _stay_together(large: Track, small: Track) -> bool:
    both = set(large.pieces) & set(small.pieces)
    if len(both) < 0.5 * min(len(large.pieces), len(small.pieces)) or not both:
        return False
    reach = TOGETHER if _one_colour(large, small) else 0.5 * TOGETHER
    close = [
        np.linalg.norm(large.pieces[t].centre - small.pieces[t].centre)
        < reach * max(large.pieces[t].radius, small.pieces[t].radius)
        for t in both
    ]
    return bool(np.mean(close) > 0.6)


def _parts_of_one(large: Track, small: Track, width: int) -> bool:
    """Whether two tracks touch each other, and each is too small for the radius that the network says, but not both.

    The votes of a large textured body may have two centres. Two bodies of which one hides a part of the other touch,
    too, but the one in front is whole.
    """
    common = sorted(set(large.pieces) & set(small.pieces))
    if len(common) < max(LEAST_COMMON, 0.5 * min(len(large.pieces), len(small.pieces))):
        return False
    pairs = [(large.pieces[t], small.pieces[t]) for t in common]
    radii = np.array([[max(p.radius, 1.0) for p in pair] for pair in pairs])
    apart = np.array([np.linalg.norm(a.centre - b.centre) for a, b in pairs]) / radii.max(1)
    filled = np.array([[len(p.pixels) for p in pair] for pair in pairs]) / (np.pi * radii**2)
    if np.median(filled, axis=0).max() > PART_FILLS:
        return False
    # Mostly: two bodies that meet are whole, and apart, before.
    if np.percentile(apart, MOSTLY) > PART_APART or np.percentile(filled.sum(1), MOSTLY) > BODY_FILLS:
        return False
    return float(np.mean([_touch(a, b, width) for a, b in pairs])) > PART_TOUCH


def _touch(one: Piece, other: Piece, width: int) -> bool:
    """Whether a pixel of one piece is beside one of the other."""
    steps = [row * width + col for row in (-1, 0, 1) for col in (-1, 0, 1)]
    return bool(np.isin(np.add.outer(steps, one.pixels), other.pixels).any())


def _stiff(tracks: list[Track], probability: np.ndarray) -> list[Track]:
    """The tracks, of which two that move as the ends of one stiff body are joined."""
    tracks = sorted(tracks, key=lambda k: -sum(len(p.pixels) for p in k.pieces.values()))
    out: list[Track] = []
    for track in tracks:
        offset, host = None, None
        for other in out:
            offset = stiff_offset(other, track, probability)
            if offset is not None:
                host = other
                break
        if host is None or offset is None:
            out.append(track)
            continue
        host.ends.append(offset)
        for t, piece in track.pieces.items():
            host.add(t, replace(piece, centre=piece.centre - offset))
    return out


def stiff_offset(one: Track, other: Track, probability: np.ndarray) -> np.ndarray | None:
    """The vector (2,) px from one track to the other if they are the ends of one stiff body, else None.

    So they are where they have one colour and the vector between their centres stays the same while both move by more
    than its length or four radii, and what is between them is not empty. Two bodies that fall side by side have nothing
    between them. Frames count by how far the track moves there: two bodies that meet and then rest are no stiff body.
    """
    common = sorted(set(one.pieces) & set(other.pieces))
    if not _one_colour(one, other) or len(common) < max(LEAST_COMMON, 0.5 * min(len(one.pieces), len(other.pieces))):
        return None
    first = np.array([one.pieces[t].centre for t in common])
    vectors = np.array([other.pieces[t].centre for t in common]) - first
    offset = np.median(vectors, axis=0)
    radii = one.typical_radius + other.typical_radius
    travel = np.linalg.norm(first - first[0], axis=1).max()
    steps = np.linalg.norm(np.gradient(first, axis=0), axis=1)
    deviation = np.average(np.linalg.norm(vectors - offset, axis=1), weights=steps + 1e-6)
    length = float(np.linalg.norm(offset))
    if deviation > STIFF[0] * radii + STIFF[1] or travel < min(length, 2 * radii) or length > 5 * radii:
        return None
    bridge = [_between(one.pieces[t], other.pieces[t], probability[t]) for t in common]
    seen = [p for p in bridge if p is not None]
    return offset if seen and np.mean(seen) > LEAST_BRIDGE else None


def _between(one: Piece, other: Piece, probability: np.ndarray) -> float | None:
    """Mean probability (H, W) of what is in the common hull of two pieces and beside both; None where nothing is."""
    own = np.zeros(probability.shape, bool)
    own.reshape(-1)[np.union1d(one.pixels, other.pixels)] = True
    # at an edge the probability is soft
    beside = convex_hull(own) & (cv2.dilate(own.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    return float(probability[beside].mean()) if beside.any() else None
