"""Pieces of one rigid body that masks show as bodies of their own: the dark ends of a cart whose middle is pale.

Each pixel has two explanations: it moves with a piece, or it belongs to the background. Frames that are shifted so that
the piece rests show which one is right (Wang and Adelson, "Representing moving images with layers", 1994). What moves
with the piece and is connected to it is its body. Other pieces that lie there belong to it, if the body turns back:
two balls that roll side by side move alike, too, until then.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.bodies.tracks.hull import convex_hull
from pipeline.bodies.tracks.image_track import MAD, ImageTrack, image_tracks, shown_whole

WORK_PX = 480  # longest side of the pictures that are compared
MOST_FRAMES = 40  # that are compared
LEAST_FRAMES = 5  # that show the piece whole
LEAST_CONTRAST, NOISES = 6.0, 4.0  # grey levels, and standard deviations of the noise, by which explanations differ
LEAST_DECIDED = 0.3  # of the frames, in which a pixel's explanations must differ
MOSTLY = 0.8  # of such frames, in which it moves with the piece; of another piece's pixels, that are in the body
LEAST_WAY, LEAST_TURN = 0.5, 0.3  # of a body's length, that it must move; of that way, that it must go back
LEAST_SHOWN = 0.1  # of the frames, in which masks show a pixel of the body
RIM_PX = 3  # around the body, by which it is recognised, too
REACH = 0.5  # lengths of the body, that it moves at most between two frames
MOST_MISSED = 0.3  # of the contrast of the body and its rim, that may differ in a frame in which it is seen


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
    count = int(masks.max(initial=0))
    whole = {body for body, is_stiff in enumerate(stiff, 1) if is_stiff}
    groups = [[body] for body in range(1, count + 1)]
    if count < 2 and not whole:
        return masks, groups
    scale = min(1.0, WORK_PX / max(masks.shape[1:]))
    small = _resized(masks, scale)
    tracks = [t for t in image_tracks(small, times) if t.body in whole or turns_back(t)]
    if not tracks:
        return masks, groups
    grey = np.stack([cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in _resized(frames, scale)])
    behind, noise = _background(small, grey)
    filled = {body: np.stack([convex_hull(own) for own in masks == body]) for body in whole}
    for track in sorted(tracks, key=lambda t: shown_whole(t).sum(), reverse=True):
        alone = [g[0] for g in groups if len(g) == 1]
        others = [b for b in alone if b != track.body and not (known[b - 1] and known[track.body - 1])]
        if track.body not in alone or not (others or track.body in whole):
            continue
        body = rigid_body(track, small, grey, behind, noise)
        if body is None:
            continue
        picture, part, places = body
        rim = with_rim(convex_hull(part))
        places = followed(picture, rim, places, grey)
        covered = placed(rim, places)
        own = {b: small == b for b in [track.body, *others]}
        group = [b for b, seen in own.items() if (seen & covered).sum() > MOSTLY * seen.sum() or b == track.body]
        if len(group) == 1 and track.body not in whole:
            continue
        group = sorted(group)
        groups = sorted([*(g for g in groups if g[0] not in group), group], key=min)
        shown = placed(np.isin(small, group), -places).mean(0) > LEAST_SHOWN
        outline = placed(convex_hull(part & convex_hull(shown)), places)
        filled[group[0]] = _resized(outline.astype(np.uint8), 1 / scale, masks.shape[2:0:-1]) > 0
    out = np.zeros_like(masks)
    for number, group in enumerate(groups, 1):
        own = filled.get(group[0], masks == group[0])
        out[own & np.isin(masks, [0, *group])] = number
    return out, groups


def turns_back(track: ImageTrack) -> bool:
    """Whether a body goes some way along a line, and back."""
    whole = shown_whole(track)
    if whole.sum() < LEAST_FRAMES:
        return False
    place = track.centre[whole] - track.centre[whole].mean(0)
    along = place @ np.linalg.svd(place, full_matrices=False)[2][0]
    way, back = float(np.ptp(along)), 0.0
    for x in (along, -along):
        highest = np.maximum.accumulate(x)
        forth = np.maximum.accumulate(np.where(x == highest, x - np.minimum.accumulate(x), 0))
        back = max(back, float(np.minimum(forth, highest - x).max()))
    return way > LEAST_WAY * float(np.median(track.axes[whole, 0])) and back > LEAST_TURN * way


def rigid_body(
    track: ImageTrack, masks: np.ndarray, grey: np.ndarray, behind: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The body to which a piece belongs; None where not even the piece keeps its picture.

    Args:
        track: Of the piece.
        masks: (T, H, W) ids.
        grey: (T, H, W) uint8, the frames.
        behind: (H, W) float32, their background, NaN where it is not known.
        noise: Of a pixel, grey levels.

    Returns:
        A picture (H, W) float32, grey levels, in which the body rests; its pixels (H, W) bool; and by how many px it is
        away from there in each frame, (T, 2), NaN where the piece is not seen whole.
    """
    whole = shown_whole(track)
    if whole.sum() < LEAST_FRAMES:
        return None
    places = np.full((len(grey), 2), np.nan)
    places[track.frames[whole]] = track.centre[whole] - np.median(track.centre[whole], axis=0)
    some = track.frames[whole][_evenly_spaced(int(whole.sum()))]
    shown = np.stack([shifted(grey[k], -places[k], np.nan) for k in some])
    resting = np.stack([shifted(behind, -places[k], np.nan) for k in some])
    seen = np.isfinite(shown).any(0)
    picture = np.full(behind.shape, np.nan, np.float32)
    picture[seen] = np.nanmedian(shown[:, seen], axis=0)
    gain = np.abs(shown - resting) - np.abs(shown - picture)
    least = max(LEAST_CONTRAST, NOISES * noise)
    moves, rests = (gain > least).sum(0), (gain < -least).sum(0)
    layer = (moves >= LEAST_DECIDED * len(some)) & (moves >= MOSTLY * (moves + rests))
    piece = np.mean([shifted(masks[k] == track.body, -places[k]) for k in some], axis=0) > 0.5
    part = _part_at(layer, piece)
    return None if part is None else (picture, part, places)


def with_rim(outline: np.ndarray) -> np.ndarray:
    """An outline (H, W) bool and the RIM_PX around it, where masks may still show the body."""
    return cv2.dilate(outline.astype(np.uint8), np.ones((2 * RIM_PX + 1,) * 2, np.uint8)) > 0


def followed(picture: np.ndarray, rim: np.ndarray, places: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """The places (T, 2) px of a body in all frames in which it is seen, NaN in the others.

    Where its piece does not tell its place, it is looked for near where it is in the frame before, or after.

    Args:
        picture: (H, W) float32 grey levels, in which it rests.
        rim: (H, W) bool, the body there and what is around it.
        places: (T, 2) px, by which it is away from there; NaN where the piece does not tell.
        grey: (T, H, W) uint8, the frames.
    """
    x, y, w, h = cv2.boundingRect(rim.astype(np.uint8))
    known = np.nan_to_num(picture[y : y + h, x : x + w])
    region = rim[y : y + h, x : x + w].astype(np.float32)
    contrast = float(((known - known[region > 0].mean()) ** 2)[region > 0].sum())

    def seen_near(k: int, centre: np.ndarray, reach: int) -> np.ndarray:
        """(2,) px of the body in frame k, at most `reach` px from a centre; NaN where it is not seen there."""
        if np.isnan(centre).any():
            return centre
        window = shifted(grey[k], reach - np.array([x, y]) - centre)[: h + 2 * reach, : w + 2 * reach]
        missed = cv2.matchTemplate(window, known, cv2.TM_SQDIFF, mask=region)
        row, col = np.unravel_index(int(missed.argmin()), missed.shape)
        seen = missed[row, col] < MOST_MISSED * contrast
        return np.asarray(centre + np.array([col, row]) - reach if seen else np.full(2, np.nan))

    far = round(REACH * float(np.hypot(w, h)))
    found = np.full(places.shape, np.nan)
    for order in (range(len(grey)), range(len(grey) - 1, -1, -1)):
        last = np.full(2, np.nan)
        for k in order:
            for centre, reach in ((places[k], 1), (last, far)):
                if np.isnan(found[k]).any():
                    found[k] = seen_near(k, centre, reach)
            if not np.isnan(found[k]).any():
                last = found[k]
    return found


def placed(outline: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(T, H, W) bool: an outline (H, W), or one for each frame, (T, H, W), moved to places (T, 2) px; empty at NaN."""
    outlines = np.broadcast_to(outline, (len(places), *outline.shape[-2:]))
    return np.stack(
        [
            np.zeros(own.shape, bool) if np.isnan(by).any() else shifted(own, by) > 0.5
            for own, by in zip(outlines, places, strict=True)
        ]
    )


def _background(masks: np.ndarray, grey: np.ndarray) -> tuple[np.ndarray, float]:
    """What is behind the bodies, (H, W) float32, NaN where they always are, and the noise, grey levels."""
    some = _evenly_spaced(len(grey))
    shown = grey[some].astype(np.float32)
    hidden = np.stack([convex_hull(masks[k] > 0) for k in some])
    background = np.median(shown, axis=0)
    behind = hidden.any(0)  # the rest needs no mask
    background[behind] = np.ma.median(np.ma.array(shown[:, behind], mask=hidden[:, behind]), axis=0).filled(np.nan)
    return background, MAD * float(np.median(np.abs(np.diff(shown, axis=0)))) / np.sqrt(2)


def _part_at(layer: np.ndarray, piece: np.ndarray) -> np.ndarray | None:
    """The connected part of a layer (H, W) bool that covers most of a piece (H, W) bool; None where none does."""
    closed = cv2.morphologyEx(layer.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    labels = cv2.connectedComponents(closed, connectivity=8)[1]
    own = np.bincount(labels[piece & (labels > 0)], minlength=1)
    return labels == own.argmax() if own.sum() and 2 * own.max() > piece.sum() else None


def _evenly_spaced(count: int) -> np.ndarray:
    """At most MOST_FRAMES of the indices of `count` frames."""
    return np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int)


def shifted(picture: np.ndarray, by: np.ndarray, fill: float = 0.0) -> np.ndarray:
    """A picture (H, W) moved by (2,) px, x and y, as float32, with a fill where nothing is known."""
    moved = np.array([[1, 0, by[0]], [0, 1, by[1]]], np.float64)
    size = picture.shape[::-1]
    return np.asarray(cv2.warpAffine(picture.astype(np.float32), moved, size, flags=cv2.INTER_LINEAR, borderValue=fill))


def _resized(pictures: np.ndarray, scale: float, size: Sequence[int] = ()) -> np.ndarray:
    """Pictures (T, H, W, ...) in another scale, of a size (width, height) if it is given; ids stay ids."""
    if scale == 1:
        return pictures
    size = tuple(size) or tuple(round(scale * n) for n in pictures.shape[2:0:-1])
    method = cv2.INTER_AREA if pictures.ndim == 4 else cv2.INTER_NEAREST
    return np.stack([cv2.resize(p, size, interpolation=method) for p in pictures])
