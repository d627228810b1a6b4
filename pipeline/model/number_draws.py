"""How a number is taken from its distribution over bins: the median, a quantile, or a peak."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from pipeline.model.fields import BINS, Field

#: Of probabilities (M, BINS) of a field: its places (M,), in bins.
Draw = Callable[[Tensor, Field], Tensor]


def zero_bin(field: Field) -> int:
    """The bin of zero, -1 for a field that has none."""
    return round(-field.low / (field.high - field.low) * (BINS - 1)) if field.zero else -1


def at_quantile(p: Tensor, quantile: Tensor, field: Field) -> Tensor:
    """Places (M,) of the quantiles (M,) of distributions (M, BINS), between bins; zero's bin is one place."""
    reached = p.cumsum(-1)
    at = (reached < quantile[:, None]).sum(-1).clamp(max=BINS - 1)
    below = torch.where(at > 0, reached.gather(1, (at - 1).clamp(min=0)[:, None])[:, 0], torch.zeros(()))
    place = at - 0.5 + (quantile - below) / p.gather(1, at[:, None])[:, 0].clamp(min=1e-9)
    return torch.where(at == zero_bin(field), at.float(), place)


def is_angle(field: Field) -> bool:
    """Whether a field is a part of an orientation, whose distribution has several peaks."""
    return field.name in ("q1", "q2", "q3")


SMOOTHING = (0.25, 0.6, 1.0, 0.6, 0.25)


def highest_peak(p: Tensor, field: Field) -> Tensor:
    """Places (M,) of the highest peaks of distributions (M, BINS)."""
    kernel = torch.tensor(SMOOTHING)
    smooth = functional.conv1d(p[:, None], kernel[None, None], padding=len(kernel) // 2)[:, 0]
    return _peak_at(p, smooth.argmax(-1), field)


def _peak_at(p: Tensor, at: Tensor, field: Field) -> Tensor:
    """Places (M,) of the mean of distributions (M, BINS) about bins (M,); zero's bin is one place."""
    window = (at[:, None] + torch.arange(-2, 3)).clamp(0, BINS - 1)
    weight = p.gather(1, window)
    place = (weight * window).sum(1) / weight.sum(1).clamp(min=1e-9)
    zero = zero_bin(field)
    return torch.where(p[:, zero] > 0.5 * weight.sum(1), torch.full_like(place, float(zero)), place)


def greedy(p: Tensor, field: Field) -> Tensor:
    """The median; of parts of an orientation the highest peak."""
    return highest_peak(p, field) if is_angle(field) else at_quantile(p, torch.full((len(p),), 0.5), field)


def sampler(middle: float, generator: torch.Generator) -> Draw:
    """Draws numbers from the middle share of their distribution; of parts of an orientation, one of the peaks."""

    def draw(p: Tensor, field: Field) -> Tensor:
        if is_angle(field):
            sharp = p**1.5
            return _peak_at(
                p, torch.multinomial(sharp / sharp.sum(-1, keepdim=True), 1, generator=generator)[:, 0], field
            )
        quantile = 0.5 + middle * (torch.rand(len(p), generator=generator) - 0.5)
        return at_quantile(p, quantile, field)

    return draw
