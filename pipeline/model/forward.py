"""The model's forward pass: its inputs (ids, patches, grids, rotary positions), and the last layer's states."""

from __future__ import annotations

import numpy as np
import torch

from pipeline.model.base import Base
from pipeline.model.patches import pack_video


def video_inputs(base: Base, clips: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Patches of clips (B, T, H, W, 3) uint8, and their grids (B, 3), where and as the model takes them."""
    device = base.model.device
    patches = pack_video(clips.to(device), base.layout).to(base.model.dtype)
    return patches, torch.tensor([base.layout.grid] * len(clips), device=device)


def rotary_positions(base: Base, ids: torch.Tensor) -> torch.Tensor:
    """Rotary positions (3, B, L) of ids (B, L): time, height and width (Qwen2-VL, section 2.1)."""
    kinds = 2 * (ids == torch.tensor(base.codec.video_token_id)).long()  # 2: video, 0: text
    videos = int(kinds.count_nonzero()) // base.layout.tokens
    grid = torch.tensor([base.layout.grid] * videos)
    return base.model.model.get_rope_index(ids, kinds, video_grid_thw=grid)[0]


def right_padded(rows: list[np.ndarray], value: int) -> torch.Tensor:
    """(B, L) of rows of different lengths."""
    out = torch.full((len(rows), max(map(len, rows))), value, dtype=torch.long)
    for i, row in enumerate(rows):
        out[i, : len(row)] = torch.as_tensor(np.asarray(row), dtype=torch.long)
    return out


def hidden_states(base: Base, ids: torch.Tensor, videos: torch.Tensor) -> torch.Tensor:
    """The last layer's states (B, L, D) of ids (B, L), padded behind, which show videos (V, T, H, W, 3) uint8 in order.

    Padding stands behind, so causal attention needs no mask.
    """
    device = base.model.device
    where = rotary_positions(base, ids.cpu()).to(device)
    patches, grid = video_inputs(base, videos)
    return base.model.model(
        input_ids=ids.to(device), pixel_values_videos=patches, video_grid_thw=grid, position_ids=where, use_cache=False
    ).last_hidden_state
