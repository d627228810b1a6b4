"""Labels of the patches of a clip, from the simulator, as auxiliary targets of the vision tower.

The text of a scene says little about where in the picture its numbers come from. A patch that an object fills has as
targets the object's shape, its place in the text, depth, the direction to its centre, and its motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import View
from pipeline.compiled import kernel
from pipeline.language.completion import MAX_OBJECTS
from pipeline.model.patches import PatchLayout
from pipeline.physics.trace import Trace
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import BASIC_SHAPES, Scene, half_extents
from pipeline.scene.solid import support

MIN_SHARE = 0.2  # of a patch's pixels on one object; below it the patch is background
SHAPES = len(BASIC_SHAPES) + 1
#: Log depth; offset to the centre of the object's pixels (2), patches; log sizes (3); at that moment, log half extents
#: along the world's axes (3), position and velocity (3 + 3); at the start of the clip, position and velocity (3 + 3)
#: and the orientation's imaginary parts (3).
NUMBERS = 24


@dataclass(frozen=True)
class PatchLabels:
    """Labels of the (t, h, w) patches of a clip.

    Attributes:
        shape: (t, h, w) int64, 0 for background, else 1 + index in `BASIC_SHAPES`.
        place: (t, h, w) int64, index of the object in the text.
        numbers: (t, h, w, NUMBERS) float32, 0 on background.
    """

    shape: np.ndarray
    place: np.ndarray
    numbers: np.ndarray


def patch_labels(view: View, scene: Scene, trace: Trace, schedule: Schedule, layout: PatchLayout) -> PatchLabels:
    """The labels, from the first frame of each of the t temporal patches; the view has the layout's size."""
    t, h, w = layout.grid
    p = layout.patch
    steps = schedule.frame_steps[schedule.pairs[:, 0]]
    shape, place = np.zeros((t, h, w), np.int64), np.zeros((t, h, w), np.int64)
    numbers = np.zeros((t, h, w, NUMBERS), np.float32)
    sizes = np.array([np.log([*o.size, *[1.0] * (3 - len(o.size))]) for o in scene.objects])
    halves = [half_extents(o) for o in scene.objects]
    rows, columns = (np.arange(n) + 0.5 for n in (h, w))
    for k in range(t):
        mask, depth, step = view.mask[k * layout.temporal], view.depth[k * layout.temporal], steps[k * layout.temporal]
        counts, sums = np.zeros((h, w, len(scene.objects))), np.zeros((len(scene.objects), 3))
        _gather(mask, depth, p, counts, sums)
        best, filled = counts.argmax(-1), counts.max(-1) >= MIN_SHARE * p**2
        for i, name in enumerate(scene.shapes):
            where = filled & (best == i)
            if where.any():
                mean_depth, x, y = sums[i] / counts[..., i].sum()
                shape[k][where] = 1 + BASIC_SHAPES.index(name)
                place[k][where] = i
                values = numbers[k]
                values[where, 0] = np.log(mean_depth)
                values[where, 1] = np.broadcast_to((x + 0.5) / p - columns, (h, w))[where]
                values[where, 2] = np.broadcast_to(((y + 0.5) / p - rows)[:, None], (h, w))[where]
                reach = support(name, halves[i][None].repeat(3, 0), matrix_from_quaternion(trace.quaternion[step, i]))
                values[where, 3:] = np.concatenate(
                    [
                        sizes[i],
                        np.log(reach),
                        trace.position[step, i],
                        trace.velocity[step, i],
                        trace.position[0, i],
                        trace.velocity[0, i],
                        scene.objects[i].orientation[1:],
                    ]
                )
    return PatchLabels(shape, place, numbers)


@kernel
def _gather(mask: np.ndarray, depth: np.ndarray, patch: int, counts: np.ndarray, sums: np.ndarray) -> None:
    """Count and sum over a mask and a depth (H, W).

    Adds to counts (h, w, N) the pixels of each object in each patch, and to sums (N, 3) the depth, x and y of each
    object's pixels.
    """
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                i = mask[y, x] - 1
                counts[y // patch, x // patch, i] += 1
                sums[i, 0] += depth[y, x]
                sums[i, 1] += x
                sums[i, 2] += y


class PatchHead(nn.Module):
    """Predicts the labels of the merge x merge patches of each token of the vision tower."""

    def __init__(self, hidden: int, layout: PatchLayout) -> None:
        super().__init__()
        self.layout = layout
        self.linear = nn.Linear(hidden, layout.merge**2 * (SHAPES + MAX_OBJECTS + NUMBERS))

    def blocks(self, labels: list[np.ndarray], device: torch.device) -> torch.Tensor:
        """(t, h, w, ...) of each clip, patch by patch, to (tokens * merge², ...) in the order of the tokens."""
        t, h, w = self.layout.grid
        m = self.layout.merge
        stacked = torch.as_tensor(np.stack(labels), device=device)
        rest = stacked.shape[4:]
        return stacked.reshape(-1, t, h // m, m, w // m, m, *rest).transpose(3, 4).reshape(-1, *rest)

    def forward(self, tokens: torch.Tensor, labels: list[PatchLabels]) -> torch.Tensor:
        """The loss of the tokens (B * tokens, hidden) of clips.

        Cross-entropy of shapes (objects and background with equal weights) and of places, plus the mean absolute error
        of the numbers on objects.
        """
        shapes, places, numbers = self.predictions(tokens)
        shape = self.blocks([x.shape for x in labels], tokens.device)
        place = self.blocks([x.place for x in labels], tokens.device)
        true = self.blocks([x.numbers for x in labels], tokens.device)
        each, filled = functional.cross_entropy(shapes, shape, reduction="none"), shape > 0
        which = functional.cross_entropy(places[filled], place[filled])
        return each[filled].mean() + each[~filled].mean() + which + (numbers - true)[filled].abs().mean()

    def predictions(self, tokens: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Logits of shapes and of places, and numbers, a row for each patch."""
        out = self.linear(tokens).float().reshape(-1, SHAPES + MAX_OBJECTS + NUMBERS)
        return out.split([SHAPES, MAX_OBJECTS, NUMBERS], dim=1)

    def shapes_right(self, tokens: torch.Tensor, labels: list[PatchLabels]) -> float:
        """Share of the patches on objects whose most likely shape is the object's."""
        true = self.blocks([x.shape for x in labels], tokens.device)
        likeliest = self.predictions(tokens)[0].argmax(1)
        return float((likeliest == true)[true > 0].float().mean())
