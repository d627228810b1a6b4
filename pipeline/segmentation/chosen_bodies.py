"""From candidates to bodies, where somebody else than `find_bodies` chooses which tracks are kept."""

from __future__ import annotations

import numpy as np

from pipeline.segmentation.bodies import BodyTracks, Candidates, draw_masks
from pipeline.segmentation.grouping import Track
from pipeline.segmentation.joining import typical_radius
from pipeline.segmentation.network import SegmentationNetwork
from pipeline.segmentation.track_score import FIGURES, PLAIN, score


def candidate_scores(found: Candidates, network: SegmentationNetwork) -> np.ndarray:
    """(N,) the probability that each candidate is a moving body."""
    regression = network.config.get("regression", PLAIN)
    return np.array([score(f, regression) for f in found.figures])


def figure(found: Candidates, name: str) -> np.ndarray:
    """(N,) one of the candidates' figures, as `track_score.FIGURES` names them."""
    return np.asarray(found.figures[:, FIGURES.index(name)])


def bodies_of(tracks: list[Track], scores: np.ndarray, found: Candidates, frames: np.ndarray) -> BodyTracks:
    """The tracks as bodies, in the order given.

    Args:
        tracks: At the size of `found.frames`.
        scores: (N,) of the tracks.
        found: The candidates among which they were chosen.
        frames: (T, H, W, 3) uint8, of the size that the masks get.
    """
    scale = np.array([frames.shape[2] / found.frames.shape[2], frames.shape[1] / found.frames.shape[1]])
    centres = np.full((len(frames), len(tracks), 2), np.nan)
    for k, track in enumerate(tracks):
        for t, piece in track.pieces.items():
            centres[t, k] = piece.centre * scale
    radii = np.array([typical_radius(t) for t in tracks]) * scale.mean()
    return BodyTracks(draw_masks(tracks, found.probability, frames), scores, centres, radii)
