"""Videos packed into the patches that Qwen2.5-VL's vision tower takes.

The official video processor needs torchvision, so this is our own; a test holds it against the official PIL image
processor on pairs of equal frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch


@dataclass(frozen=True)
class PatchLayout:
    """How clips are cut into patches and tokens.

    Attributes:
        width: Of the frames, px.
        height: Of the frames, px.
        frames: Of a clip.
        patch: Side of a patch, px.
        temporal: Frames of a patch.
        merge: merge x merge patches make one token.
        mean: Per colour channel, of values in 0..1.
        std: Per colour channel, of values in 0..1.
        places: Strength of the position signal that replaces the third channel (`places`); 0: none, as in published
            models.
    """

    width: int
    height: int
    frames: int
    patch: int
    temporal: int = 2
    merge: int = 2
    mean: tuple[float, float, float] = (0.48145466, 0.4578275, 0.40821073)
    std: tuple[float, float, float] = (0.26862954, 0.26130258, 0.27577711)
    places: float = 0.0

    def __post_init__(self) -> None:
        unit = self.patch * self.merge
        assert self.width % unit == self.height % unit == 0, f"frame sides are multiples of {unit} px"
        assert self.frames % self.temporal == 0, f"the number of frames is a multiple of {self.temporal}"

    @property
    def grid(self) -> tuple[int, int, int]:
        """Patches in time, height and width."""
        return self.frames // self.temporal, self.height // self.patch, self.width // self.patch

    @property
    def tokens(self) -> int:
        t, h, w = self.grid
        return t * h * w // self.merge**2


def places(layout: PatchLayout) -> torch.Tensor:
    """(t, 1, h, p, w, p) of `layout.places` times -1 to 1: in the left third of a patch its column, in the middle its
    row, on the right its time.

    The vision tower's rotary embedding only says how far patches are apart; where one is in the picture, and so in
    the world, a small model would have to learn from the borders.
    """
    stripe = torch.arange(layout.patch) * 3 // layout.patch
    across = [
        (2 * (torch.arange(n) + 0.5) / n - 1).reshape(shape)
        for n, shape in zip(layout.grid, ((-1, 1, 1), (1, -1, 1), (1, 1, -1)), strict=True)
    ]
    time, row, column = torch.broadcast_tensors(*across)
    values = torch.stack([column, row, time], -1)[..., stripe]  # t, h, w, p
    return layout.places * values[:, None, :, None].expand(-1, 1, -1, layout.patch, -1, -1)


def resize_frames(frames: np.ndarray, width: int, height: int) -> np.ndarray:
    """Frames (T, H, W, 3) uint8 at another size, by area averaging where they shrink."""
    if frames.shape[1:3] == (height, width):
        return frames
    shrinks = frames.shape[2] > width
    return np.stack(
        [cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR) for f in frames]
    )


def fit_layout(pictures: np.ndarray, layout: PatchLayout) -> np.ndarray:
    """Pictures (P, h, w, 3) uint8 in the layout's size."""
    return resize_frames(pictures, layout.width, layout.height)


def pack_video(frames: torch.Tensor, layout: PatchLayout) -> torch.Tensor:
    """Patches (B * T/t * h * w, 3 * t * p * p) float32 of clips (B, T, H, W, 3) uint8, as the vision tower wants them.

    Order: time, then blocks of merge x merge patches row by row, then the patches of a block; within a patch
    channel, time, row, column.
    """
    batch = len(frames)
    t, h, w = layout.grid
    p, m, s = layout.patch, layout.merge, layout.temporal
    mean = torch.tensor(layout.mean, device=frames.device)
    scale = 1 / (255 * torch.tensor(layout.std, device=frames.device))
    x = (frames.float() - 255 * mean) * scale
    if layout.places:
        x.view(batch, t, s, h, p, w, p, 3)[..., 2] = places(layout).to(x.device)
    x = x.reshape(batch, t, s, h // m, m, p, w // m, m, p, 3)
    x = x.permute(0, 1, 3, 6, 4, 7, 9, 2, 5, 8)  # B, t, h/m, w/m, m, m, C, s, p, p
    return x.reshape(batch * t * h * w, 3 * s * p * p)
