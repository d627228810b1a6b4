"""Numbers written one after another, each as a distribution over bins given all before it."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.objects.fields import BINS, Field

WAVES = 5  # sines and cosines of a number's place in its range
INNER = 128  # features of a number's last layer
SPREAD = 1.0  # bins, of the Gaussian that stands for a number in training
ZERO = 1e-6
#: Of probabilities (M, BINS) of a field: its places (M,), in bins.
Draw = Callable[[Tensor, Field], Tensor]


class NumberChain(nn.Module):
    """p(v1 | h) p(v2 | h, v1) …; where there are `choices`, one of them is chosen first and conditions the rest."""

    low: Tensor
    high: Tensor
    frequency: Tensor

    def __init__(self, fields: tuple[Field, ...], width: int, choices: int = 0) -> None:
        super().__init__()
        self.fields = fields
        count = len(fields)
        self.register_buffer("low", torch.tensor([float(f.low) for f in fields]), persistent=False)
        self.register_buffer("high", torch.tensor([float(f.high) for f in fields]), persistent=False)
        self.register_buffer("frequency", math.pi * 2.0 ** torch.arange(WAVES), persistent=False)
        self.value = nn.Parameter(torch.randn(count, 1 + 2 * WAVES, width) * 0.1)
        self.index = nn.Parameter(torch.randn(count, 2 * width) * 0.02)
        self.norm, self.last_norm = nn.LayerNorm(width), nn.LayerNorm(width)
        self.up, self.down = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.inner = nn.Parameter(torch.randn(count, width, INNER) / width**0.5)
        self.outer = nn.Parameter(torch.zeros(count, INNER, BINS))
        self.bias = nn.Parameter(torch.zeros(count, BINS))
        if choices:
            layers = (nn.LayerNorm(width), nn.Linear(width, width), nn.GELU(), nn.Linear(width, choices))
            self.choose = nn.Sequential(*layers)
            self.chosen = nn.Embedding(choices, width)

    def waves(self, values: Tensor, some: slice = slice(None)) -> Tensor:
        """Features (…, K, 1 + 2 WAVES) of numbers (…, K) on their scales."""
        share = (2 * (values - self.low[some]) / (self.high[some] - self.low[some]) - 1).clamp(-1.2, 1.2)
        phase = share[..., None] * self.frequency
        return torch.cat([share[..., None], phase.sin(), phase.cos()], -1)

    def embedded(self, values: Tensor, some: slice = slice(None)) -> Tensor:
        """(…, K, width) of numbers (…, K) on their scales."""
        return torch.einsum("...kf,kfd->...kd", self.waves(values, some), self.value[some])

    def logits(self, context: Tensor, some: slice = slice(None)) -> Tensor:
        """(M, K, BINS) of contexts (M, K, width)."""
        c = context + self.down(functional.gelu(self.up(self.norm(context)) + self.index[some]))
        inner = functional.gelu(torch.einsum("mkd,kdf->mkf", self.last_norm(c), self.inner[some]))
        return torch.einsum("mkf,kfb->mkb", inner, self.outer[some]) + self.bias[some]

    def losses(self, h: Tensor, values: Tensor, choice: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
        """Losses (M, K) of true numbers (M, K), on their scales, and (M,) of the choice, nats.

        Args:
            h: (M, width) what is known.
            values: (M, K).
            choice: (M,) the true choices.
        """
        first = None
        if choice is not None:
            first = functional.cross_entropy(self.choose(h), choice, reduction="none")
            h = h + self.chosen(choice)
        each = self.embedded(values)
        before = torch.cumsum(each, 1) - each
        log_p = self.logits(h[:, None] + before).log_softmax(-1)
        return -(self.soft_targets(values) * log_p).sum(-1), first

    def soft_targets(self, values: Tensor) -> Tensor:
        """(M, K, BINS): a Gaussian about each number's place; exact zeros in fields that have them are one bin."""
        place = ((values - self.low) / (self.high - self.low) * (BINS - 1)).clamp(0, BINS - 1)
        soft = torch.exp(-0.5 * ((torch.arange(BINS, device=values.device) - place[..., None]) / SPREAD) ** 2)
        hard = functional.one_hot(place.round().long(), BINS).float()
        zero = torch.tensor([f.zero for f in self.fields], device=values.device) & (values.abs() < ZERO)
        soft = torch.where(zero[..., None], hard, soft)
        return soft / soft.sum(-1, keepdim=True)

    @torch.no_grad()
    def write(self, h: Tensor, draw: Draw, choice: Tensor | None = None, free: Tensor | None = None) -> tuple:
        """Numbers (M, K) on their scales and their log-probabilities (M,), nats.

        Args:
            h: (M, width) what is known.
            draw: Takes a number from its distribution.
            choice: (M,) the choice that was made.
            free: (M, K) bool, the numbers that the choice has; the others are 0.
        """
        if choice is not None:
            h = h + self.chosen(choice)
        numbers, total = [], torch.zeros(len(h))
        for k, field in enumerate(self.fields):
            some = slice(k, k + 1)
            p = self.logits(h[:, None], some)[:, 0].softmax(-1)
            place = draw(p, field).clamp(0, BINS - 1)
            value = self.low[k] + place * (self.high[k] - self.low[k]) / (BINS - 1)
            if field.zero:
                value = torch.where(value.abs() < 1e-5, torch.zeros(()), value)
            log_p = p.gather(1, place.round().long()[:, None])[:, 0].clamp(min=1e-9).log()
            if free is not None:
                value = torch.where(free[:, k], value, torch.zeros(()))
                log_p = torch.where(free[:, k], log_p, torch.zeros(()))
            numbers.append(value)
            total = total + log_p
            h = h + self.embedded(value[:, None], some)[:, 0]
        return torch.stack(numbers, 1), total


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
