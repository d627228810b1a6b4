"""One pass of the model over prompts, clips and completions."""

from __future__ import annotations

import torch

from pipeline.model.base import Base
from pipeline.model.inputs import positions, video_inputs


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
