"""The model's forward pass: its inputs (ids, patches, grids, rotary positions), and the last layer's states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from pipeline.model.base import Base
from pipeline.model.patches import pack_video


def video_inputs(base: Base, clips: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Patches of clips (B, T, H, W, 3) uint8, and their grids (B, 3), where and as the model takes them."""
    device = base.model.device
    patches = pack_video(clips.to(device), base.layout).to(base.model.dtype)
    return patches, torch.tensor([base.layout.grid] * len(clips), device=device)


def prompt_positions(base: Base, prompt: Sequence[int]) -> torch.Tensor:
    """Rotary positions (3, P) of a prompt's ids (P,): time, height and width (Qwen2-VL, section 2.1)."""
    ids = torch.tensor([prompt])
    kinds = 2 * (ids == torch.tensor(base.codec.video_token_id)).long()  # 2: video, 0: text
    videos = prompt.count(base.codec.video_token_id) // base.layout.tokens
    grid = torch.tensor([base.layout.grid] * videos)
    positions, _ = base.model.model.get_rope_index(ids, kinds, video_grid_thw=grid)
    return positions[:, 0]


def positions(base: Base, length: int) -> torch.Tensor:
    """Rotary positions (3, L) of the bare prompt and the text behind it, which counts on from the prompt's largest."""
    prompt = prompt_positions(base, base.codec.prompt_ids)
    following = torch.arange(length - prompt.shape[1]) + prompt.max() + 1
    return torch.cat([prompt, following.expand(3, -1)], 1)


def right_padded(rows: list[np.ndarray], value: int) -> torch.Tensor:
    """(B, L) of rows of different lengths."""
    out = torch.full((len(rows), max(map(len, rows))), value, dtype=torch.long)
    for i, row in enumerate(rows):
        out[i, : len(row)] = torch.as_tensor(np.asarray(row), dtype=torch.long)
    return out


def hidden_states(base: Base, ids: torch.Tensor, clips: torch.Tensor) -> torch.Tensor:
    """The last layer's states (B, L, D) of ids (B, L), padded behind, on clips (B, T, H, W, 3) uint8.

    Padding stands behind, so causal attention needs no mask.
    """
    device = base.model.device
    where = positions(base, ids.shape[1])[:, None].expand(-1, len(ids), -1).to(device)
    patches, grid = video_inputs(base, clips)
    return base.model.model(
        input_ids=ids.to(device), pixel_values_videos=patches, video_grid_thw=grid, position_ids=where, use_cache=False
    ).last_hidden_state
