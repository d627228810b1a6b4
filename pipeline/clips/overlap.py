"""Intersection over union of instances over a sequence, as docs/formats.md defines it.

Everything starts from counts: per frame, the pixels that predicted instance i shares with true instance j, and the
area of each. So the same rules serve a search's inner loop and the tables.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.compiled import kernel


@dataclass(frozen=True)
class Counts:
    """shared (F, N, M) pixels of predicted instance i and true instance j together; predicted (F, N), true (F, M)
    areas; foreground (F, 2): pixels in both unions of objects, in either."""

    shared: np.ndarray
    predicted: np.ndarray
    true: np.ndarray
    foreground: np.ndarray

    def frames(self, which: slice) -> Counts:
        """The counts of some of the frames."""
        return Counts(self.shared[which], self.predicted[which], self.true[which], self.foreground[which])


@kernel
def count_frame(
    mask: np.ndarray,
    target: np.ndarray,
    shared: np.ndarray,
    predicted: np.ndarray,
    true: np.ndarray,
    foreground: np.ndarray,
) -> None:
    """Fill the counts of one frame from two masks (H, W) uint8 (0 background): shared (N, M), …, foreground (2,)."""
    shared[:] = 0
    predicted[:] = 0
    true[:] = 0
    foreground[:] = 0
    for row in range(mask.shape[0]):
        for col in range(mask.shape[1]):
            i, j = mask[row, col], target[row, col]
            if i:
                predicted[i - 1] += 1
                if j:
                    shared[i - 1, j - 1] += 1
                    foreground[0] += 1
                foreground[1] += 1
            if j:
                true[j - 1] += 1
                if not i:
                    foreground[1] += 1


def count(masks: np.ndarray, targets: np.ndarray, objects: int, target_objects: int) -> Counts:
    """Counts of predicted masks (F, H, W) against true ones of the same size.

    Raises:
        ValueError: The masks differ in size, or have more instances than said.
    """
    if masks.shape != targets.shape:
        raise ValueError(f"masks of the sizes {masks.shape} and {targets.shape} cannot be compared")
    if masks.max(initial=0) > objects or targets.max(initial=0) > target_objects:
        raise ValueError(f"masks have more than the {objects} and {target_objects} instances that were said")
    frames = len(masks)
    out = Counts(
        np.zeros((frames, objects, target_objects), np.int64),
        np.zeros((frames, objects), np.int64),
        np.zeros((frames, target_objects), np.int64),
        np.zeros((frames, 2), np.int64),
    )
    for k in range(frames):
        count_frame(masks[k], targets[k], out.shared[k], out.predicted[k], out.true[k], out.foreground[k])
    return out


def pair_iou(counts: Counts) -> np.ndarray:
    """(..., F, N, M) IoU of every pair in every frame, NaN where both are empty."""
    union = counts.predicted[..., :, None] + counts.true[..., None, :] - counts.shared
    return np.where(union > 0, counts.shared / np.maximum(union, 1), np.nan)


def assign(iou: np.ndarray) -> np.ndarray:
    """(P, 2) pairs of predicted and true instances, one assignment for the clip, that maximise the summed IoU."""
    rows, columns = linear_sum_assignment(-np.nansum(iou, axis=0))
    return np.stack([rows, columns], 1)


def sequence_iou(counts: Counts, pairs: np.ndarray) -> np.ndarray:
    """Mean over pairs of the mean IoU over the frames in which either of the pair is seen; of one clip, or (...) of
    counts with leading axes.

    An instance without a partner counts 0; one that is never seen, alone or with its partner, is left out.
    """
    iou = pair_iou(counts)[..., pairs[:, 0], pairs[:, 1]]  # (..., F, P)
    seen = ~np.isnan(iou)
    scores = np.where(seen, iou, 0).sum(-2) / np.maximum(seen.sum(-2), 1)
    lone_predicted = np.setdiff1d(np.arange(counts.predicted.shape[-1]), pairs[:, 0])
    lone_true = np.setdiff1d(np.arange(counts.true.shape[-1]), pairs[:, 1])
    unmatched = [side.any(-2).sum(-1) for side in (counts.predicted[..., lone_predicted], counts.true[..., lone_true])]
    return scores.sum(-1) / np.maximum(seen.any(-2).sum(-1) + sum(unmatched), 1)


def foreground_iou(counts: Counts) -> float:
    """Mean over frames of the IoU of the unions of all objects; frames with neither are left out."""
    both, either = counts.foreground[:, 0], counts.foreground[:, 1]
    seen = either > 0
    return float((both[seen] / either[seen]).mean()) if seen.any() else 0.0


@dataclass(frozen=True)
class Overlap:
    """How well the masks of a sequence agree.

    Attributes:
        sequence: IoU of the instances over all frames.
        initial: IoU of the instances in the first frame.
        foreground: IoU of the unions of all objects.
        pairs: (P, 2) Which predicted instance was assigned to which true one, once for the sequence.
    """

    sequence: float
    initial: float
    foreground: float
    pairs: np.ndarray


def overlap(masks: np.ndarray, targets: np.ndarray, objects: int, target_objects: int) -> Overlap:
    """Compare predicted masks (F, H, W) of so many objects with true ones of the same size."""
    counts = count(masks, targets, objects, target_objects)
    pairs = assign(pair_iou(counts))
    return Overlap(
        float(sequence_iou(counts, pairs)),
        float(sequence_iou(counts.frames(slice(1)), pairs)),
        foreground_iou(counts),
        pairs,
    )
