"""An auxiliary loss on RAFT's features: a cell's correlation should peak where the cell moves to.

RAFT's own loss reaches the features only through the recurrent updates, which learn nothing before the features are
informative. The auxiliary loss is the cross-entropy between the softmax of a cell's correlation and the bilinear
weights of its true target, as in supervised matching (LoFTR, Sun et al. 2021). It acts from the first step on, and
trains positions finer than a cell.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from pipeline.vision.flow.raft_layers import CELL, Correlation

MIN_FOREGROUND = 0.3  # share of a cell's pixels on moving bodies from which on the cell counts


def matching_loss(correlation: Correlation, flow_px: Tensor, foreground: Tensor) -> Tensor:
    """Mean cross-entropy over the cells of moving bodies, nats.

    Args:
        correlation: Of B pairs.
        flow_px: (B, 2, H, W) true flow.
        foreground: (B, H, W) bool, pixels of moving bodies.
    """
    volume = correlation.pyramid[0]
    h, w = volume.shape[-2:]
    logits = volume.flatten(1).log_softmax(dim=-1)  # (B h w, h w)
    share = F.avg_pool2d(foreground[:, None].float(), CELL)  # (B, 1, h, w)
    flow = F.avg_pool2d(flow_px * foreground[:, None], CELL) / share.clamp(min=1e-6)
    moves = share > MIN_FOREGROUND
    flow = torch.where(moves, flow, torch.zeros_like(flow)) / CELL
    y, x = torch.meshgrid(torch.arange(h, device=flow.device), torch.arange(w, device=flow.device), indexing="ij")
    target_x, target_y = (x + flow[:, 0]).flatten(), (y + flow[:, 1]).flatten()  # (B h w,), in cells
    left, top = target_x.floor(), target_y.floor()
    total = torch.zeros_like(target_x)
    known = torch.zeros_like(target_x)
    for column, row in ((left, top), (left + 1, top), (left, top + 1), (left + 1, top + 1)):
        weight = (1 - (target_x - column).abs()) * (1 - (target_y - row).abs())
        inside = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        index = (row.clamp(0, h - 1) * w + column.clamp(0, w - 1)).long()
        total = total - weight * inside * logits.gather(1, index[:, None])[:, 0]
        known = known + weight * inside
    moving = moves.flatten().float()
    return (total * moving).sum() / (known * moving).sum().clamp(min=1e-6)
