"""The flow of registered bodies: inside an outline their rigid motion replaces flow that was measured badly."""

from __future__ import annotations

import numpy as np

from pipeline.search.outlines.registration import Registration
from pipeline.search.outlines.spin import fill_surface
from pipeline.vision.rendering.surface import KINDS

FACING = 0.02  # least cosine between normal and line of sight; pixels beyond it have the flow of the body's mean
LEAST_PIXELS = 4


def replace_flow(
    flow: np.ndarray, own: np.ndarray, found: Registration, pairs: np.ndarray, mask_width: int
) -> np.ndarray:
    """The flow with that of one registered body where its rotation is known.

    Args:
        flow: (P, h, w, 2) px of its own size.
        own: (P, h, w) bool, the pixels of the instance in the first frame of each pair.
        found: The registration.
        pairs: (P, 2) frames of the clip.
        mask_width: Width of the masks to which it was registered, px.
    """
    out = flow.copy()
    height, width = flow.shape[1:3]
    focal = found.focal * width / mask_width
    half, centres = np.ascontiguousarray(found.half), found.centres
    for p, (first, second) in enumerate(pairs_known(found, pairs)):
        if first < 0:
            continue
        rows, columns = np.nonzero(own[p])
        if len(rows) < LEAST_PIXELS:
            continue
        pixels = np.stack([columns + 0.5 - width / 2, height / 2 - rows - 0.5], 1)
        points, normals, seen = np.zeros((len(rows), 3)), np.zeros((len(rows), 3)), np.zeros(len(rows), bool)
        fill_surface(KINDS[found.shape], half, np.ascontiguousarray(found.rotations[first]), centres[first], pixels,
                     focal, FACING, points, normals, seen)  # fmt: skip
        if seen.sum() < LEAST_PIXELS:
            continue
        moved = points @ _turn(found, first, second).T + centres[second]
        after = focal * moved[:, :2] / -moved[:, 2:]
        change = (after - pixels) * np.array([1.0, -1.0])
        change[~seen] = change[seen].mean(0)
        out[p, rows, columns] = change
    return out


def _turn(found: Registration, first: int, second: int) -> np.ndarray:
    """(3, 3) rotation from one frame of a registration to a later one."""
    turn = np.eye(3)
    for k in range(first, second):
        turn = found.turns[k] @ turn
    return turn


def pairs_known(found: Registration, pairs: np.ndarray) -> np.ndarray:
    """(P, 2) positions in the registration of the frames of each pair; -1 where the turn between them is unknown."""
    place = {int(frame): k for k, frame in enumerate(found.frames)}
    out = np.full((len(pairs), 2), -1)
    for p, (first, second) in enumerate(pairs):
        a, b = place.get(int(first), -1), place.get(int(second), -1)
        if a >= 0 and b > a and found.turns_seen[a:b].all():
            out[p] = a, b
    return out
