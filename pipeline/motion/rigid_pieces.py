"""Pieces of one rigid body that masks show as bodies of their own: the dark ends of a cart whose middle is pale.

Two pieces are one body if the vector between them rests while both turn back together, and if what lies between them
differs from the background. Two balls that fall side by side turn back together, too, but between them is background.
A piece that is seen for a while, where one of the others would be, belongs to them. What is seen only where such a body
is, too.

Pieces that touch, or have something between them, whichever of them is seen, are one body, too, if their common hull
keeps its length and area while they go some way and turn back. Where only a small part of such a body is found, the
whole is put so that this part is one of its pieces and all of it differs from the background; else it is left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components

from pipeline.motion.completed_body import completed, differing, shown_whole
from pipeline.motion.followed_body import followed
from pipeline.motion.hull import convex_hull
from pipeline.motion.image_track import MAD, ImageTrack, image_tracks

LEAST_FRAMES = 10  # that show both
LEAST_SHARE = 0.8  # of the frames of the shorter track, that show both
STIFF_PX, STIFF_SHARE = 0.8, 0.01  # most deviation of the vector between them; its share of that vector
STIFF_WAY = 0.03  # the same as a share of the way that both move: masks of pieces may gain and lose parts
MOST_BESIDE = 0.3  # of a piece's frames, that show the one whose place it takes, too
SAME_PLACE = 0.15  # of the vector between two pieces: most median distance of a third one from one of them
LEAST_WAY = 0.5  # of a length: what both must move
LEAST_TURN = 0.3  # of that way, that they must go back
LEAST_BRIDGE = 0.5  # of what is between them must differ from the background
LEAST_COMMON = 3  # frames that show two pieces
MOSTLY = 0.8  # share of frames in which pieces of one body touch, or a body covers a piece; share that it covers
TOUCH_PX = 2  # between pieces that touch
LEAST_WHOLE = 0.6  # share of the frames that show it whole


def joined_pieces(
    masks: np.ndarray, frames: np.ndarray, times: np.ndarray, known: Sequence[bool], stiff: Sequence[bool] = ()
) -> tuple[np.ndarray, list[list[int]]]:
    """Masks in which the pieces of one rigid body are one body, filled up to their convex hull.

    Args:
        masks: (T, H, W) ids from 1.
        frames: (T, H, W, 3) uint8 RGB.
        times: (T,) s.
        known: Of each body, whether the user pointed at it; two such bodies stay two.
        stiff: Of each body, whether it is several ends of a rigid body already; its masks are filled up, too.

    Returns:
        Masks whose bodies are numbered in the order of their first pieces, and the pieces of each body.
    """
    tracks = image_tracks(masks, times)
    groups = [[body] for body in range(1, int(masks.max(initial=0)) + 1)]
    for one, other in itertools.combinations(tracks, 2):
        both_known = known[one.body - 1] and known[other.body - 1]
        if not both_known and moves_stiffly(one, other) and _bridged(masks, frames, one, other):
            groups = _merged(groups, [one.body, other.body])
    for pieces in linked_sets(masks, frames, tracks):
        if sum(known[body - 1] for body in pieces) < 2 and keeps_shape(hulls_of(masks, pieces), times):
            groups = _merged(groups, pieces)
    whole = {body for body, is_stiff in enumerate(stiff, 1) if is_stiff}
    if not whole and all(len(g) == 1 for g in groups):
        return masks, groups
    _take_in(groups, {t.body: t for t in tracks}, known)
    filled = {}
    for group in groups:
        if len(group) > 1:
            own = np.where(np.isin(masks, group), masks, 0)
            filled[group[0]] = followed(completed(own, frames, hulls_of(masks, group), times), frames, times)
        elif group[0] in whole:
            filled[group[0]] = hulls_of(masks, group)
    _take_in_covered(groups, masks, filled, known)
    groups.sort(key=min)
    out = np.zeros_like(masks)
    for number, group in enumerate(groups, 1):
        own = filled.get(group[0], masks == group[0])
        out[own & np.isin(masks, [0, *group])] = number
    return out, groups


def hulls_of(masks: np.ndarray, bodies: Sequence[int]) -> np.ndarray:
    """(T, H, W) bool: the common convex hull of bodies of masks (T, H, W)."""
    return np.stack([convex_hull(own) for own in np.isin(masks, bodies)])


def _merged(groups: list[list[int]], bodies: Sequence[int]) -> list[list[int]]:
    """The groups, of which all that have one of the bodies are one; in the order of their first bodies."""
    hit = [g for g in groups if set(g) & set(bodies)]
    rest = [g for g in groups if g not in hit]
    return sorted([*rest, sorted(itertools.chain.from_iterable(hit))], key=min)


def moves_stiffly(one: ImageTrack, other: ImageTrack) -> bool:
    """Whether the vector between two tracks rests while both go some way and turn back."""
    _, i, j = np.intersect1d(one.frames, other.frames, return_indices=True)
    if len(i) < max(LEAST_FRAMES, LEAST_SHARE * min(len(one), len(other))):
        return False
    apart = _vectors(one, other)
    middle = np.median(apart, axis=0)
    length = float(np.linalg.norm(middle))
    spread = MAD * float(np.median(np.abs(apart - middle), axis=0).max())
    way, back = _way_and_back(0.5 * (one.centre[i] + other.centre[j]))
    if spread > max(STIFF_PX, STIFF_SHARE * length, STIFF_WAY * way):
        return False
    return _goes_and_returns(way, back, length)


def linked_sets(masks: np.ndarray, frames: np.ndarray, tracks: Sequence[ImageTrack]) -> list[list[int]]:
    """Sets of two or more bodies, each of which mostly touches another one, or has no background between them.

    Args:
        masks: (T, H, W) ids from 1.
        frames: (T, H, W, 3) uint8 RGB.
        tracks: Of the bodies.
    """
    linked = _touching(masks)
    for one, other in itertools.combinations(tracks, 2):
        pair = one.body - 1, other.body - 1
        common = len(np.intersect1d(one.frames, other.frames))
        if not linked[pair] and common >= LEAST_FRAMES and _turn_back_near(one, other):
            linked[pair] = _bridged(masks, frames, one, other)
    number, label = connected_components(linked, directed=False)
    sets = [[body + 1 for body in np.flatnonzero(label == k).tolist()] for k in range(number)]
    return [bodies for bodies in sets if len(bodies) > 1]


def _turn_back_near(one: ImageTrack, other: ImageTrack) -> bool:
    """Whether two tracks go further than they are ever apart, and turn back."""
    _, i, j = np.intersect1d(one.frames, other.frames, return_indices=True)
    way, back = _way_and_back(0.5 * (one.centre[i] + other.centre[j]))
    return _goes_and_returns(way, back, float(np.linalg.norm(_vectors(one, other), axis=1).max()))


def _touching(masks: np.ndarray) -> np.ndarray:
    """(N, N) bool: pairs of bodies of masks (T, H, W) that mostly touch while both are seen; the first one's row."""
    count = int(masks.max(initial=0))
    both, touching = np.zeros((2, count, count), int)
    near = np.ones((2 * TOUCH_PX + 1,) * 2, np.uint8)
    for mask in masks:
        blobs = cv2.connectedComponents(cv2.dilate((mask > 0).astype(np.uint8), near))[1]
        blob_of = {int(body) - 1: np.bincount(blobs[mask == body]).argmax() for body in np.unique(mask[mask > 0])}
        for one, other in itertools.combinations(blob_of, 2):
            both[one, other] += 1
            touching[one, other] += blob_of[one] == blob_of[other]
    return np.asarray((both >= LEAST_COMMON) & (touching >= MOSTLY * both))


def keeps_shape(hulls: np.ndarray, times: np.ndarray) -> bool:
    """Whether hulls (T, H, W) bool at times (T,) s mostly show one shape, which goes some way and turns back."""
    tracks = image_tracks(hulls, times)
    if not tracks or len(tracks[0]) < LEAST_FRAMES:
        return False
    track, whole = tracks[0], shown_whole(tracks[0])
    if whole.mean() < LEAST_WHOLE:
        return False
    way, back = _way_and_back(track.centre[whole])
    return _goes_and_returns(way, back, float(np.median(track.axes[whole, 0])))


def _goes_and_returns(way: float, back: float, length: float) -> bool:
    """Whether a way and the way back, of `_way_and_back`, are long beside a length, px."""
    return way > LEAST_WAY * length and back > LEAST_TURN * way


def _way_and_back(place: np.ndarray) -> tuple[float, float]:
    """How far places (T, 2) reach along their main line, px, and the longest way back along it."""
    centred = place - place.mean(0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    return float(np.ptp(along)), _turned_back(along)


def _take_in(groups: list[list[int]], tracks: dict[int, ImageTrack], known: Sequence[bool]) -> None:
    """Add single bodies to the groups of pieces in which they take the place of a piece that is not seen."""
    for single in [g for g in groups if len(g) == 1 and g[0] in tracks and not known[g[0] - 1]]:
        for group in (g for g in groups if len(g) > 1):
            pieces = [tracks[b] for b in group if b in tracks]
            pairs = itertools.permutations(pieces, 2)
            if any(_takes_place(tracks[single[0]], beside, missing) for beside, missing in pairs):
                groups.remove(single)
                group += single
                break


def _take_in_covered(
    groups: list[list[int]], masks: np.ndarray, filled: dict[int, np.ndarray], known: Sequence[bool]
) -> None:
    """Add single bodies to the group whose whole body, by its first piece, mostly covers them."""
    for single in [g for g in groups if len(g) == 1 and g[0] not in filled and not known[g[0] - 1]]:
        own = masks == single[0]
        seen = own.any((1, 2))
        for group in (g for g in groups if g[0] in filled):
            inside = (own & filled[group[0]]).sum((1, 2)) > MOSTLY * own.sum((1, 2))
            if seen.any() and inside[seen].mean() > MOSTLY:
                groups.remove(single)
                group += single
                break


def _takes_place(track: ImageTrack, beside: ImageTrack, missing: ImageTrack) -> bool:
    """Whether a track is where a piece that is missing then would be, as seen from the piece beside it."""
    if len(np.intersect1d(track.frames, missing.frames)) > MOST_BESIDE * len(track):
        return False
    vector = _vectors(beside, missing)
    own = _vectors(beside, track)
    if not len(vector) or len(own) < LEAST_SHARE * len(track):
        return False
    middle = np.median(vector, axis=0)
    away = np.linalg.norm(own - middle, axis=1)
    return float(np.median(away)) < SAME_PLACE * float(np.linalg.norm(middle))


def _vectors(one: ImageTrack, other: ImageTrack) -> np.ndarray:
    """(N, 2) px from one track to the other, in the frames that show both."""
    _, i, j = np.intersect1d(one.frames, other.frames, return_indices=True)
    return np.asarray(other.centre[j] - one.centre[i])


def _turned_back(along: np.ndarray) -> float:
    """The longest way back of places (T,) along a line, after a way forth that is as long or longer."""
    most = 0.0
    for sign in (1, -1):
        x = sign * along
        highest = np.maximum.accumulate(x)
        forth = np.maximum.accumulate(np.where(x == highest, x - np.minimum.accumulate(x), 0))
        back = highest - x
        most = max(most, float(np.minimum(forth, back).max()))
    return most


def _bridged(masks: np.ndarray, frames: np.ndarray, one: ImageTrack, other: ImageTrack) -> bool:
    """Whether most of what is between two pieces differs from the background."""
    common = np.intersect1d(one.frames, other.frames)
    hulls = np.zeros(masks.shape, bool)
    for k in common:
        hulls[k] = convex_hull((masks[k] == one.body) | (masks[k] == other.body))
    differs, known = differing(frames, hulls, common)
    between = [hulls[k] & (masks[k] == 0) & known for k in common]
    shares = [float(d[b].mean()) for d, b in zip(differs, between, strict=True) if b.any()]
    return bool(shares) and float(np.median(shares)) > LEAST_BRIDGE
