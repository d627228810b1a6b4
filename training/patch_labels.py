"""What the simulator knows for nothing of each patch of a clip, to teach the vision tower what is where.

Of each patch: the shape that fills it (or background), and for objects the logarithm of depth and the way from the
patch's middle to the middle of the object's picture, in patches.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from pipeline.clips.view import View
from pipeline.model.patches import PatchLayout
from pipeline.scene.scene import BASIC_SHAPES

LEAST_SHARE = 0.2  # of a patch's pixels, below which it is background
NUMBERS = 3  # log depth, dx, dy


def patch_labels(view: View, shapes: tuple[str, ...], layout: PatchLayout) -> tuple[np.ndarray, np.ndarray]:
    """Class (t, h, w) int64, 0 background, 1 + index in `BASIC_SHAPES`; numbers (t, h, w, 3) float32.

    From the first frame of each of the t temporal patches; the view is of the layout's size.
    """
    t, h, w = layout.grid
    p = layout.patch
    classes, numbers = np.zeros((t, h, w), np.int64), np.zeros((t, h, w, NUMBERS), np.float32)
    codes = [1 + BASIC_SHAPES.index(s) for s in shapes]
    rows, columns = (np.arange(n) + 0.5 for n in (h, w))
    for k in range(t):
        mask, depth = view.mask[k * layout.temporal], view.depth[k * layout.temporal]
        shares = np.stack([(mask == i + 1).reshape(h, p, w, p).mean((1, 3)) for i in range(len(shapes))], -1)
        best = shares.argmax(-1)
        filled = shares.max(-1) >= LEAST_SHARE
        for i, code in enumerate(codes):
            where = filled & (best == i)
            if where.any():
                y, x = np.nonzero(mask == i + 1)
                classes[k][where] = code
                numbers[k, where, 0] = np.log(depth[y, x].mean())
                numbers[k, where, 1] = np.broadcast_to((x.mean() + 0.5) / p - columns, (h, w))[where]
                numbers[k, where, 2] = np.broadcast_to(((y.mean() + 0.5) / p - rows)[:, None], (h, w))[where]
    return classes, numbers


class PatchHead(nn.Module):
    """Predicts the labels of the merge x merge patches of each token of the vision tower."""

    def __init__(self, hidden: int, layout: PatchLayout) -> None:
        super().__init__()
        self.layout = layout
        self.classes = len(BASIC_SHAPES) + 1
        self.linear = nn.Linear(hidden, layout.merge**2 * (self.classes + NUMBERS))

    def blocks(self, labels: torch.Tensor) -> torch.Tensor:
        """(B, t, h, w, ...) patch by patch to (B * tokens, merge², ...), in the order of the tokens."""
        t, h, w = self.layout.grid
        m = self.layout.merge
        rest = labels.shape[4:]
        labels = labels.reshape(-1, t, h // m, m, w // m, m, *rest).transpose(3, 4)
        return labels.reshape(-1, m * m, *rest)

    def forward(self, tokens: torch.Tensor, classes: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        """Loss of tokens (B * tokens, hidden): cross-entropy, objects and background weighted alike, plus the mean
        absolute error of the numbers on objects."""
        out = self.linear(tokens).float().reshape(len(tokens), self.layout.merge**2, -1)
        target, values = self.blocks(classes), self.blocks(numbers)
        each = functional.cross_entropy(out[..., : self.classes].flatten(0, 1), target.flatten(), reduction="none")
        filled = target.flatten() > 0
        error = (out[..., self.classes :].flatten(0, 1) - values.flatten(0, 1)).abs()[filled]
        return each[filled].mean() + each[~filled].mean() + error.mean()
