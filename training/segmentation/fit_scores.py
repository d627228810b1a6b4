"""Fit the score of tracks: which of those that the network finds are moving bodies.

    python -m training.segmentation.fit_scores CLIPS WEIGHTS

CLIPS: a folder of clips of `training.segmentation.generate` that the network was not trained on. Writes a logistic
regression on `track_score.FIGURES` into WEIGHTS/config.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import torch
from scipy.optimize import minimize
from tqdm import tqdm

from pipeline.bodies.candidates import find_candidates
from pipeline.bodies.networks.mask_networks import MaskNetworks, load_mask_networks
from pipeline.bodies.networks.network import CONFIG
from pipeline.bodies.tracks.grouping import Track
from pipeline.bodies.tracks.track_score import FIGURES
from training.segmentation.clip import MOVES, TrainingClip
from training.segmentation.kept_arrays import load_arrays

IS_BODY, IS_NONE = 0.4, 0.15  # video IoU with a moving body, from which and up to which a track is one and is none
PENALTY = 0.02  # of the squared weights of standardised figures


def track_iou(track: Track, mask: np.ndarray, body: int) -> float:
    """Mean IoU of a track with a body over the frames in which either is seen. mask: (T, H, W) ids."""
    values = []
    for t, true in enumerate(mask):
        own = true.ravel() == body
        piece = track.pieces.get(t)
        if piece is None:
            if own.any():
                values.append(0.0)
            continue
        shared = own[piece.pixels].sum()
        values.append(shared / (len(piece.pixels) + own.sum() - shared))
    return float(np.mean(values)) if values else 0.0


def labelled_tracks(networks: MaskNetworks, clip: TrainingClip) -> tuple[np.ndarray, np.ndarray]:
    """Figures (N, F) of a clip's tracks, and whether they are moving bodies (N,): 1, 0, or NaN (not clear)."""
    found = find_candidates(clip.frames, networks.moving)
    size = (found.frames.shape[2], found.frames.shape[1])
    mask = np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST_EXACT) for m in clip.mask])
    labels = np.full(len(found.tracks), np.nan)
    claimed: set[int] = set()
    for k, track in enumerate(found.tracks):
        overlaps = [track_iou(track, mask, i + 1) for i in range(len(clip.state))]
        best = int(np.argmax(overlaps))
        if overlaps[best] < IS_NONE:
            labels[k] = 0
        elif clip.state[best] != MOVES:
            continue
        elif best in claimed:
            labels[k] = 0
        elif overlaps[best] >= IS_BODY:
            labels[k] = 1
            claimed.add(best)
    return found.figures, labels


def fit(figures: np.ndarray, labels: np.ndarray) -> dict[str, float]:
    """Weights by figure, and the constant, of a penalised logistic regression of labels (N,) on figures (N, F)."""
    centre, spread = figures.mean(0), figures.std(0) + 1e-6
    standard = np.concatenate([np.ones((len(figures), 1)), (figures - centre) / spread], 1)
    sign = 2 * labels - 1

    def loss(weights: np.ndarray) -> float:
        return float(np.logaddexp(0, -sign * (standard @ weights)).mean() + PENALTY * (weights[1:] ** 2).sum())

    found = minimize(loss, np.zeros(standard.shape[1])).x
    weights = found[1:] / spread
    return {"constant": float(found[0] - weights @ centre), **dict(zip(FIGURES, map(float, weights), strict=True))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    cv2.setNumThreads(1)
    networks = load_mask_networks(arguments.weights)
    paths = sorted(arguments.clips.glob("*.npz"))
    rows = [labelled_tracks(networks, load_arrays(p, TrainingClip)) for p in tqdm(paths, unit="clip", disable=None)]
    figures, labels = np.concatenate([r[0] for r in rows]), np.concatenate([r[1] for r in rows])
    clear = ~np.isnan(labels)
    regression = fit(figures[clear], labels[clear])
    chosen = figures[clear] @ np.array([regression[k] for k in FIGURES]) + regression["constant"] > 0
    right = (chosen == (labels[clear] > 0.5)).mean()
    print(f"{clear.sum()} tracks, {int(labels[clear].sum())} of them bodies; {right:.1%} told right\n{regression}")
    path = arguments.weights / CONFIG
    config = {**json.loads(path.read_text()), "regression": {k: round(v, 4) for k, v in regression.items()}}
    path.with_suffix(".part").write_text(json.dumps(config, indent=2) + "\n")
    path.with_suffix(".part").replace(path)


if __name__ == "__main__":
    main()
