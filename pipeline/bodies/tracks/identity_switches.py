"""Identity switches: tracks that go on as another body where two bodies meet.

A puck that stops where it hits another one, which goes on at the same speed, looks like one puck that goes on: its
track takes over the place of the other one, whose own track ends, and a new track begins where the first puck stopped.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.bodies.tracks.grouping import Track

LATEST = 3  # frames between the end of the one track and the beginning of the other
TAKEN, LEFT = 1.5, 3.0  # radii from the place that is taken over, and from the place where the first body was last
SAME_SIZE = 1.5  # most ratio of their radii
AHEAD = 5  # frames of a track, from which its motion is led back
LEAST_AREA, LEAST_RUN = 0.5, 3  # of the median: smaller pieces, and fewer in a row, before a track begins are flecks


def without_switches(tracks: Sequence[Track], frames: int) -> list[Track]:
    """The tracks, of which each that went on as another body has its own body's pieces.

    Args:
        tracks: Of a clip.
        frames: Their number.
    """
    for struck, passing in itertools.permutations(tracks, 2):
        met = struck.last
        if met + LATEST >= frames or not _takes_over(passing, struck, met):
            continue
        others = [k for k in tracks if k is not struck and k is not passing]
        began = next((k for k in others if _left_behind(k, passing, struck, met)), None)
        if began is None:
            continue
        start = _begin(began)
        own = {t: p for t, p in passing.pieces.items() if t <= met and t < start}
        rest = {t: p for t, p in began.pieces.items() if t >= start}
        onward = {t: p for t, p in passing.pieces.items() if t > met}
        mended = replace(passing, pieces=own | rest), replace(struck, pieces=struck.pieces | onward)
        return without_switches([*(k for k in others if k is not began), *mended], frames)
    return list(tracks)


def _takes_over(passing: Track, struck: Track, met: int) -> bool:
    """Whether a track that is seen before is where another one was last seen, in frame `met`, right after."""
    after = [t for t in passing.pieces if met < t <= met + LATEST]
    if not after or passing.first >= met or passing.last <= met + LATEST:
        return False
    return _apart(passing, min(after), struck, met) < TAKEN * (1 + min(after) - met)


def _left_behind(began: Track, passing: Track, struck: Track, met: int) -> bool:
    """Whether a track begins, at about frame `met`, where the passing one was last."""
    start = _begin(began)
    before = [t for t in passing.pieces if t <= min(met, start)]
    if abs(start - met) > LATEST or not before:
        return False
    sizes = [_radius(k) for k in (began, passing, struck)]
    return max(sizes) < SAME_SIZE * min(sizes) and _apart(began, start, passing, max(before)) < LEFT


def _begin(track: Track) -> int:
    """The first of LEAST_RUN frames in a row in which a track is no fleck; its last frame without any."""
    least = LEAST_AREA * track.typical_area
    large = {t for t, p in track.pieces.items() if len(p.pixels) >= least}
    return min((t for t in large if large.issuperset(range(t, t + LEAST_RUN))), default=track.last)


def _radius(track: Track) -> float:
    """px, of which there is at least one."""
    return max(track.typical_radius, 1.0)


def _apart(one: Track, when: int, other: Track, then: int) -> float:
    """Distance of two tracks' centres in their frames `when` and `then`, in radii of the larger one."""
    distance = np.linalg.norm(one.pieces[when].centre - other.pieces[then].centre)
    return float(distance) / max(_radius(one), _radius(other))


def without_leaps(tracks: Sequence[Track]) -> list[Track]:
    """The tracks, of which each that was lost for some frames goes on as what fits best, among itself and the tracks
    that begin meanwhile.

    A body that bounces while it is not seen goes on from the place where it was last seen, whatever its velocity.
    """
    for track, other in itertools.permutations(tracks, 2):
        start = _begin(other)
        for last, after in itertools.pairwise(sorted(track.pieces)):
            if after == last + 1 or not last < start <= after:
                continue
            if _misfit(track, last, other, start) < _misfit(track, last, track, after):
                before = {t: p for t, p in track.pieces.items() if t <= last}
                onward = {t: p for t, p in other.pieces.items() if t >= start}
                left = {t: p for t, p in track.pieces.items() if t >= after}
                rest = [k for k in tracks if k is not track and k is not other]
                mended = replace(track, pieces=before | onward), replace(other, pieces=left)
                return without_leaps([*rest, *mended])
    return list(tracks)


def _misfit(track: Track, last: int, other: Track, start: int) -> float:
    """How ill a track that is last seen in frame `last` goes on as another one from `start` on: the distance, in radii,
    from where its own pieces lead back to, and the ratio of their radii."""
    seen = [t for t in sorted(other.pieces) if t >= start][:AHEAD]
    centres = np.array([other.pieces[t].centre for t in seen])
    if len(seen) < LEAST_RUN:
        return np.inf
    way = [np.polyval(np.polyfit(np.array(seen) - last, x, 1), 0) for x in centres.T]
    size = np.median([len(other.pieces[t].pixels) for t in seen]) / track.typical_area
    return float(np.linalg.norm(way - track.pieces[last].centre)) / _radius(track) + 0.5 * abs(float(np.log(size)))
