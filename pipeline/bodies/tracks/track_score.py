"""The probability that a track is a moving body: a logistic regression on a few of its figures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.bodies.networks.inference import Prediction
from pipeline.bodies.tracks.grouping import Track

#: Names of the figures, in the order in which `track_figures` gives them.
FIGURES = (
    "moving",
    "strongest",
    "body",
    "other",
    "length",
    "log_radius",
    "fill",
    "spread",
    "shift",
    "shift_radii",
    "edge",
)
#: Used where the weights' folder has no regression: the mean probability, less what looks like a hand.
PLAIN = {"constant": -3.0, "moving": 6.0, "other": -4.0}


def track_figures(track: Track, prediction: Prediction) -> np.ndarray:
    """(len(FIGURES),) of one track.

    Means over its pixels of the three probabilities, and the 90th percentile of `moving`; the share of the clip's
    frames in which it is seen; log of its radius, px; its area over that of a disc of the radius; the median distance
    of a vote from its centre, or from the nearest end of a stiff body, in radii; how far it shifts, px as a logarithm,
    and in radii; the share of frames in which it touches the picture's border.
    """
    count, height, width = prediction.moving.shape
    flat = [a.reshape(count, -1) for a in (prediction.moving, prediction.body, prediction.other)]
    votes = prediction.vote.reshape(count, -1, 2)
    means, spread, edge = [], [], []
    for t, piece in track.pieces.items():
        values = [a[t, piece.pixels] for a in flat]
        means.append([values[0].mean(), np.percentile(values[0], 90), values[1].mean(), values[2].mean()])
        centres = piece.centre + np.array([np.zeros(2), *track.ends])  # of the body, or of each of its ends
        away = np.linalg.norm(votes[t, piece.pixels][:, None] - centres, axis=-1).min(1)
        spread.append(np.median(away) / max(piece.radius, 1.5))
        edge.append(piece.at_border(height, width))
    moving, strongest, body, other = np.mean(means, axis=0)
    centres = np.array([track.pieces[t].centre for t in sorted(track.pieces)])
    shift = float(np.percentile(np.linalg.norm(centres - np.median(centres[:3], axis=0), axis=1), 90))
    radius = max(track.typical_radius, 1.0)
    area = np.mean([len(p.pixels) for p in track.pieces.values()])
    return np.array(
        [
            moving,
            strongest,
            body,
            other,
            len(track.pieces) / count,
            np.log(radius),
            min(area / (np.pi * radius**2), 3.0),
            np.mean(spread),
            np.log1p(shift),
            min(shift / radius, 10.0),
            np.mean(edge),
        ]
    )


def score(figures: np.ndarray, regression: Mapping[str, float]) -> float:
    """Probability that a track with these figures is a moving body. regression: a weight by figure, and `constant`."""
    weights = np.array([regression.get(name, 0.0) for name in FIGURES])
    return float(1 / (1 + np.exp(-(regression["constant"] + figures @ weights))))
