"""The loss of the segmentation network, and what its log shows."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from pipeline.bodies.networks.inputs import network_input
from pipeline.bodies.networks.network import BODY, MOVING, OTHER, VOTE_SCALE_PX, SegmentationNetwork
from training.segmentation.clip import BODY_SHADOW
from training.segmentation.clip import OTHER as OTHER_LABEL

HARD = 2.0  # added weight of what moves, or differs from the background, and is no body: it is the hardest to tell
CHANGED = 0.05  # of full scale: smoothed difference to the background from here on
PARTS = ("moving", "body", "other", "offset_px", "log_radius", "iou_moving", "iou_body", "iou_other")


def dice(probability: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """1 - Dice's coefficient of each picture (B, H, W), mean over them; 20 px are added to both areas."""
    shared = (probability * target * weight).sum((1, 2))
    areas = ((probability + target) * weight).sum((1, 2))
    return (1 - (2 * shared + 20) / (areas + 20)).mean()


def overlap(logit: Tensor, target: Tensor, weight: Tensor) -> Tensor:
    """IoU of the thresholded logits with the target over a whole batch."""
    hit = (logit > 0).float()
    return (hit * target * weight).sum() / (((hit + target) > 0) * weight).sum().clamp(min=1)


def segmentation_loss(network: SegmentationNetwork, batch: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
    """The loss of a batch of `samples.batched`, and PARTS of it (8,)."""
    full, half = network_input(*(batch[k] for k in ("frame", "background", "low", "high", "flicker", "others", "flow")))
    full, half = (x.contiguous(memory_format=torch.channels_last) for x in (full, half))
    logits, votes = (x.float() for x in network(full, half))
    moving, body, other, known, visible = (batch[k] for k in ("moving", "body", "other", "known", "visible"))

    def entropy(channel: int, target: Tensor, weight: Tensor) -> Tensor:
        each = F.binary_cross_entropy_with_logits(logits[:, channel], target, reduction="none")
        return (each * weight).sum() / weight.sum().clamp(min=1)

    change = F.avg_pool2d((batch["frame"] - batch["background"]).abs().amax(1, True), 3, 1, 1)[:, 0]
    hard = 1 + HARD * ((other > 0) | ((change > CHANGED) & (body == 0))).float()
    everywhere = (other != BODY_SHADOW).float()
    other = (other == OTHER_LABEL).float()
    parts = [
        entropy(MOVING, moving, known * hard),
        entropy(BODY, body, visible * hard),
        entropy(OTHER, other, everywhere * (1 + HARD * (other + moving))),
    ]
    probability = torch.sigmoid(logits)
    area = 4 * parts[0] + 2 * parts[1] + 2 * parts[2]
    area = area + dice(probability[:, MOVING], moving, known) + 0.5 * dice(probability[:, BODY], body, visible)
    area = area + 0.5 * dice(probability[:, OTHER], other, everywhere)
    weight = batch["weight"] / (batch["weight"].sum() + 1e-6)
    # A vote is right within a share of the body's radius, so errors on large bodies count less.
    scale = (VOTE_SCALE_PX / (VOTE_SCALE_PX / 2 + batch["log_radius"].exp())).clamp(max=1.5)
    apart = (votes[:, :2] - batch["offset"]).abs().sum(1) * weight
    offset = (apart * scale).sum()
    radius = ((votes[:, 2] - batch["log_radius"]).abs() * weight).sum()
    shown = [
        *parts,
        apart.sum() * VOTE_SCALE_PX,
        radius,
        overlap(logits[:, MOVING], moving, known),
        overlap(logits[:, BODY], body, visible),
        overlap(logits[:, OTHER], other, everywhere),
    ]
    return area + 1.5 * offset + 0.3 * radius, torch.stack(shown).detach()
