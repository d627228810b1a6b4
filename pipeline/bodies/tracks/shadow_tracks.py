"""Tracks that are the shadow of a body on plain ground or on a wall behind it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from pipeline.bodies.tracks.cast_shadows import DARKEST, MOST_TINT
from pipeline.bodies.tracks.grouping import Track

LEAST_COMMON = 6  # frames in which a body and its shadow are seen
LEAST_TRAVEL = 4.0  # radii that both must go
MOST_DRIFT, MOST_APART = 0.12, 8.0  # mean deviation of the shadow's place beside its body, over their way; radii
DARKER = 0.04  # least drop of the logarithm in a shadow, its soft rim included
SHADED = 0.85  # share of a shadow's pixels that are so


def shadows_among(tracks: Sequence[Track], frames: np.ndarray) -> set[int]:
    """Which of some tracks move beside another one as its shadow does: their indices.

    A shadow is the background, darker, without another tint. Where both of a pair are so, as a grey ball in front of
    a white wall, the shadow is the one with less contrast inside.

    Args:
        tracks: Of a clip.
        frames: (T, H, W, 3) uint8. Their median is the background.
    """
    pairs = [p for p in itertools.combinations(range(len(tracks)), 2) if go_side_by_side(*(tracks[k] for k in p))]
    if not pairs:
        return set()
    behind = np.log(np.median(frames, axis=0).reshape(-1, 3).astype(np.float32) + DARKEST)
    shades = {k: shade_of(tracks[k], frames, behind) for k in {k for pair in pairs for k in pair}}
    shaded = [[k for k in pair if shades[k][0] >= SHADED] for pair in pairs]
    return {min(some, key=lambda k: shades[k][1]) for some in shaded if some}


def shade_of(track: Track, frames: np.ndarray, behind: np.ndarray) -> tuple[float, float]:
    """The share of a track's pixels that are the background in a shade, and the contrast inside: the mean deviation of
    the logarithm. behind: (H W, 3), logarithm of the background."""
    shaded, contrast = [], []
    for t, piece in track.pieces.items():
        ratio = np.log(frames[t].reshape(-1, 3)[piece.pixels].astype(np.float32) + DARKEST) - behind[piece.pixels]
        shade = ratio.mean(-1)
        tint = np.abs(ratio - shade[:, None]).max(-1)
        shaded.append(np.mean((shade < -DARKER) & (tint < MOST_TINT)))
        contrast.append(shade.std())
    return float(np.mean(shaded)), float(np.mean(contrast))


def go_side_by_side(one: Track, other: Track) -> bool:
    """Whether two tracks go the same way beside each other."""
    common = sorted(set(one.pieces) & set(other.pieces))
    if len(common) < max(LEAST_COMMON, 0.5 * min(len(one.pieces), len(other.pieces))):
        return False
    places = np.array([[track.pieces[t].centre for track in (one, other)] for t in common])
    radius = max(one.typical_radius, other.typical_radius)
    travel = np.linalg.norm(np.ptp(places, axis=0), axis=-1).min()
    offset = places[:, 1] - places[:, 0]
    drift = np.linalg.norm(offset - np.median(offset, axis=0), axis=-1).mean()
    apart = np.linalg.norm(np.median(offset, axis=0))
    return bool(travel > LEAST_TRAVEL * radius and drift < MOST_DRIFT * travel and apart < MOST_APART * radius)
