"""Candidates for the moving bodies of a clip, found by the networks for masks; the masks of those that are chosen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.bodies.networks.inference import Prediction, predict, steadied
from pipeline.bodies.networks.inputs import ClipFeatures, clip_features, steady_exposure
from pipeline.bodies.networks.network import STRIDE, SegmentationNetwork
from pipeline.bodies.networks.plate import clear_plate
from pipeline.bodies.networks.upsampling import enlarge
from pipeline.bodies.tracks.cast_shadows import cast_shadows
from pipeline.bodies.tracks.grouping import Track, follow
from pipeline.bodies.tracks.joining import joined
from pipeline.bodies.tracks.resting import ALIKE, covered, resting, without_ghosts
from pipeline.bodies.tracks.track_score import FIGURES, PLAIN, score, track_figures

WORK_PX = 240 * 160  # of the picture that the network sees
LEAST_SCORE = 0.4  # from which a track counts as a body; the background of the second look is without such tracks
LEVEL = 0.38  # of a soft mask, at a body's edge: 0.5 draws bodies 6 % (rendered clips) to 14 % (real ones) too small
LEAST_PART = 0.2  # of a body's largest connected part: smaller ones are flecks
IN_SHADOW = 0.2  # factor of the probability where the background's texture is seen, darker


@dataclass(frozen=True)
class Candidates:
    """Tracks before any is dropped. frames: (T, h, w, 3) uint8, what the network saw. probability: (T, h, w), steadied.
    figures: (N, F) of `track_score.FIGURES`. changed: (T, h, w) bool, where a frame differs from the background by more
    than a shadow."""

    frames: np.ndarray
    changed: np.ndarray
    prediction: Prediction
    probability: np.ndarray
    tracks: list[Track]
    figures: np.ndarray


def working_size(width: int, height: int, pixels: int = WORK_PX) -> tuple[int, int]:
    """Width and height, multiples of STRIDE, with the picture's shape and about so many pixels."""
    scale = math.sqrt(pixels / (width * height))
    w, h = (max(round(scale * side / STRIDE), 2) * STRIDE for side in (width, height))
    return w, h


def find_candidates(frames: np.ndarray, network: SegmentationNetwork) -> Candidates:
    """Tracks of whatever may be a moving body.

    The network looks twice. A body that rests for most of the clip, or is slow, is in the median picture; the second
    look has a background without the bodies that the first one found.

    Args:
        frames: (T, H, W, 3) uint8.
        network: For moving bodies.

    Raises:
        ValueError: For frames of another type or shape, or a single one.
    """
    if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8 or len(frames) < 2:
        raise ValueError(f"frames are (T, H, W, 3) uint8 with T of 2 or more, not {frames.shape} {frames.dtype}")
    first, features = first_look(frames, network)
    small = first.frames
    scores = candidate_scores(first, network)
    likely = [t for t, s in zip(first.tracks, scores, strict=True) if s >= LEAST_SCORE]
    rests = resting([without_ghosts(t, small, features.background) for t in likely], small)
    behind = np.stack([covered(rests, t, small.shape[1:3]) for t in range(len(small))])
    plate, filled = clear_plate(small, behind, features.background)
    if np.array_equal(plate, features.background):
        return first
    again = predict(network, small, replace(features, background=plate))
    # Where the background is not known, a body that the first look saw there stays.
    moving = np.where(behind & filled, np.maximum(again.moving, first.prediction.moving), again.moving)
    return _tracked(replace(again, moving=moving), small, plate)


def first_look(frames: np.ndarray, network: SegmentationNetwork) -> tuple[Candidates, ClipFeatures]:
    """Tracks of what differs from the clip's median picture, and what they were found with; frames as above."""
    size = working_size(frames.shape[2], frames.shape[1])
    small = steady_exposure(np.stack([cv2.resize(f, size, interpolation=cv2.INTER_AREA) for f in frames]))
    features = clip_features(small)
    return _tracked(predict(network, small, features), small, features.background), features


def _tracked(prediction: Prediction, small: np.ndarray, background: np.ndarray) -> Candidates:
    probability, shadows = steadied(prediction.moving, small), cast_shadows(small, background)
    probability[shadows] *= IN_SHADOW
    changed = np.stack([cv2.absdiff(frame, background).max(-1) >= ALIKE for frame in small]) & ~shadows
    tracks = joined(follow(prediction, probability, small), probability)
    figures = [track_figures(t, prediction) for t in tracks]
    table = np.array(figures).reshape(len(tracks), len(FIGURES))
    return Candidates(small, changed, prediction, probability, tracks, table)


def candidate_scores(found: Candidates, network: SegmentationNetwork) -> np.ndarray:
    """(N,) the probability that each candidate is a moving body."""
    regression = network.config.get("regression", PLAIN)
    return np.array([score(f, regression) for f in found.figures])


def draw_masks(tracks: list[Track], probability: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Ids (T, H, W) uint8 of the tracks, in their order from 1, at the size of frames (T, H, W, 3).

    probability: (T, h, w) that a pixel shows a moving body, at the size of the tracks' pixels.
    """
    count, h, w = probability.shape
    out = np.zeros(frames.shape[:3], np.uint8)
    for t in range(count):
        owner = np.zeros(h * w, np.uint8)
        for k, track in enumerate(tracks, 1):
            if t in track.pieces:
                owner[track.pieces[t].pixels] = k
        owner = owner.reshape(h, w)
        best = np.full(frames.shape[1:3], LEVEL, np.float32)
        for k, track in enumerate(tracks, 1):
            if t not in track.pieces:
                continue
            own = _main_parts(owner == k)
            near = cv2.dilate(own.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
            soft = np.where(own, np.maximum(probability[t], 0.5), np.where(near & (owner == 0), probability[t], 0.0))
            large, window = enlarge(soft.astype(np.float32), frames[t])
            better = large > best[window]
            out[t][window][better] = k
            best[window][better] = large[better]
    return out


def _main_parts(mask: np.ndarray) -> np.ndarray:
    """A mask (h, w) bool without connected parts that are small beside its largest."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count <= 2:
        return mask
    kept = stats[:, cv2.CC_STAT_AREA] >= LEAST_PART * stats[1:, cv2.CC_STAT_AREA].max()
    kept[0] = False
    return np.asarray(kept[labels])
