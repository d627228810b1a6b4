"""Soft targets of the numbers of a training text: a Gaussian over neighbouring numbers.

With a hard target, all wrong tokens are equally wrong, and that 0.53 m is close to 0.54 m must be learned from examples
of both. A soft target is symmetric, so that the median, which a greedy answer takes, does not move. Zeros, and real
parts of 1, keep hard targets: they mean that a body is at rest or not rotated.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from pipeline.language.codec import Codec
from pipeline.language.completion import (
    FOV,
    GRAVITY,
    HEIGHT,
    IMAGINARY_PART,
    MATERIAL,
    PITCH,
    REAL_PART,
    SIZE,
    VECTORS,
)
from pipeline.language.grammar import Element, Number, pieces

#: Standard deviation of the targets, in the number's own unit: about half of the model's error.
SPREAD: dict[Element, float] = {
    HEIGHT: 0.05,
    PITCH: 1.5,
    FOV: 1.5,
    GRAVITY: 0.6,
    SIZE: 0.015,
    MATERIAL["mass"]: 0.3,
    MATERIAL["sliding_friction"]: 0.1,
    MATERIAL["rolling_friction"]: 0.005,
    MATERIAL["damping"]: 0.1,
    VECTORS["position"]: 0.05,
    VECTORS["velocity"]: 0.12,
    VECTORS["angular_velocity"]: 0.8,
    REAL_PART: 0.04,
    IMAGINARY_PART: 0.08,
}
REACH = 3  # standard deviations


@dataclass(frozen=True)
class SoftTargets:
    """The targets as a sparse matrix of M entries; shares of a place add up to 1.

    Attributes:
        at: (M,) place in the text's ids.
        ids: (M,) token.
        share: (M,) float32, probability of the token in the target.
    """

    at: np.ndarray
    ids: np.ndarray
    share: np.ndarray


def soft_targets(codec: Codec, segments: Sequence[tuple[Element, str]]) -> SoftTargets:
    """The soft targets of the numbers in `SPREAD` of a completion, as `split` cuts it.

    The tokenizer must have numbers in two tokens, as ours has.
    """
    parts: list[tuple[int, np.ndarray, np.ndarray]] = []
    place, positions = len(codec.prompt_ids), 0
    for element, text in segments:
        length = len(codec.segment_ids(element, text))
        positions += element == VECTORS["position"]
        height = element == VECTORS["position"] and positions % 3 == 0  # a body on the ground has its size as height
        if element in SPREAD and not height:
            assert isinstance(element, Number)
            assert length == 2
            parts += [(place + k, *found) for k, found in enumerate(_of_number(codec, element, text))]
        place += length
    at = np.repeat([p for p, *_ in parts], [len(ids) for _, ids, _ in parts]).astype(np.int64)
    return SoftTargets(at, *(np.concatenate([p[k] for p in parts]) for k in (1, 2)))


@functools.lru_cache(maxsize=1 << 14)
def _of_number(codec: Codec, number: Number, text: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """(ids, shares) of the first token, over all numbers, and of the second, over those with the same first token."""
    heads, tails = _tokens(codec, number)
    scale, value = 10**number.decimals, float(text)
    lowest, at = round(number.low * scale), round(value * scale)
    exact = value == (1 if number == REAL_PART else 0)
    reach = 0 if exact else round(REACH * SPREAD[number] * scale)
    first, last = max(at - reach - lowest, 0), min(at + reach - lowest + 1, len(heads))
    near = np.exp(-0.5 * ((np.arange(first, last) + lowest - at) / (SPREAD[number] * scale)) ** 2)
    same_head = heads[first:last] == heads[at - lowest]
    return [_shares(heads[first:last], near), _shares(tails[first:last][same_head], near[same_head])]


def _shares(ids: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct ids, and the share of the weight of each."""
    found, which = np.unique(ids, return_inverse=True)
    return found, (np.bincount(which, weight) / weight.sum()).astype(np.float32)


@functools.lru_cache(maxsize=64)
def _tokens(codec: Codec, number: Number) -> tuple[np.ndarray, np.ndarray]:
    """First and second token of all numbers that can stand there, in ascending order."""
    scale = 10**number.decimals
    values = np.arange(round(number.low * scale), round(number.high * scale) + 1) / scale
    cut = [pieces(number, number.text(v)) for v in values.tolist()]
    heads, tails = ([id_ for (id_,) in map(codec.piece_ids, part)] for part in zip(*cut, strict=True))
    return np.array(heads), np.array(tails)


def soft_loss(log_p: torch.Tensor, labels: torch.Tensor, soft: list[SoftTargets], prompt: int) -> torch.Tensor:
    """Mean cross-entropy over the places with a label, nats.

    Args:
        log_p: (B, L, V) log-probabilities of the places from `prompt` on.
        labels: (B, L) tokens; -100 where a place carries no loss.
        soft: Of each of the B texts; a place with a soft target uses it instead of its label.
        prompt: Length of the prompt.
    """
    learned = labels != -100
    hard = learned.clone()
    columns = [np.repeat(np.arange(len(soft)), [len(s.at) for s in soft])]
    columns += [np.concatenate([getattr(s, key) for s in soft]) for key in ("at", "ids", "share")]
    row, at, ids, share = (torch.as_tensor(column, device=log_p.device) for column in columns)
    hard[row, at - prompt] = False
    where = hard.nonzero(as_tuple=True)
    total = (log_p[(row, at - prompt, ids)] * share).sum() + log_p[(*where, labels[where])].sum()
    return -total / learned.sum()
