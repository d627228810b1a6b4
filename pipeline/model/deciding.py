"""Answers of the words model, decision by decision, greedy or sampled, with a key-value cache."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor
from transformers import DynamicCache

from pipeline.model import decisions as d
from pipeline.model.fields import BINS, NOTHING
from pipeline.model.number_draws import greedy, sampler
from pipeline.model.sampling import Sampling
from pipeline.model.words_network import WordsNetwork


@torch.no_grad()
def decide(
    network: WordsNetwork,
    prompt: tuple[Tensor, Tensor],
    places: Sequence[int],
    frame: bool,
    sampling: Sampling,
    seed: int,
    shape_prior: np.ndarray | None = None,
) -> tuple[list[d.Said], np.ndarray]:
    """Answers to one prompt, and their log-probabilities, nats.

    Args:
        network: The model.
        prompt: (1, L, width) and rotary positions (3, 1, L).
        places: Of the bodies in the prompt; of a frame those that may be named.
        frame: Whether the prompt shows whole frames.
        sampling: How many answers and how they are drawn.
        seed: Makes them repeatable.
        shape_prior: (N, 3) probability of each basic shape by another source; None: not known.
    """
    rows = sampling.samples
    generator = torch.Generator().manual_seed(seed)
    draw = sampler(sampling.middle, generator) if sampling.temperature else greedy
    cache = DynamicCache(config=network.qwen.config.get_text_config())
    network.language_states(*prompt, cache)
    if rows > 1:
        cache.batch_repeat_interleave(rows)
    steps = [d.decisions(places, sampling.reasoning, frame) for _ in range(rows)]
    asked: list[d.Decision | None] = [next(s) for s in steps]
    before: list[tuple[int, float]] = [(d.REASON if sampling.reasoning else d.DIRECT, 0.0)] * rows
    said: list[d.Said | None] = [None] * rows
    log_p = np.zeros(rows)
    body = {d.PLACE0 + p: i for i, p in enumerate(places)}
    while any(a is not None for a in asked):
        states = _advance(network, before, asked, cache)
        groups: dict[tuple[int, tuple[int, ...]], list[int]] = defaultdict(list)
        for i, a in enumerate(asked):
            if a is not None:
                groups[a.ask, a.allowed].append(i)
        taken: dict[int, tuple[int, float]] = {}
        for (ask, allowed), members in groups.items():
            h = states[members]
            if allowed:
                p = network.qwen.lm_head(h).float()[:, list(allowed)].softmax(-1)
                if ask == d.ASK_SHAPE and shape_prior is not None:
                    p = _with_prior(p, shape_prior[[body[asked[i].of] for i in members]])  # type: ignore[union-attr]
                picks = _picked(p, sampling, generator)
                log_p[members] += p.gather(1, picks[:, None])[:, 0].log().numpy()
                for i, pick in zip(members, picks.tolist(), strict=True):
                    taken[i] = allowed[pick], 0.0
            else:
                field = d.FIELDS[ask - d.ASK_FIELD]
                p = network.bins(h).float().softmax(-1)
                spot = draw(p, field).clamp(0, BINS - 1)
                log_p[members] += p.gather(1, spot.round().long()[:, None])[:, 0].clamp(min=1e-9).log().numpy()
                for i, s in zip(members, spot.tolist(), strict=True):
                    value = field.low + s * (field.high - field.low) / (BINS - 1)
                    taken[i] = d.FIELD0 + ask - d.ASK_FIELD, 0.0 if field.zero and abs(value) < 1e-5 else value
        for i, (token, value) in taken.items():
            index = asked[i].field  # type: ignore[union-attr]
            before[i] = token, d.share_of(value, index) if index >= 0 else 0.0
            try:
                asked[i] = steps[i].send((token, value))
            except StopIteration as end:
                said[i], asked[i] = end.value, None
    return [s for s in said if s is not None], log_p


def _advance(
    network: WordsNetwork, before: list[tuple[int, float]], asked: list[d.Decision | None], cache: DynamicCache
) -> Tensor:
    """(R, width) states that decide what is asked; rows that are done are fed what nothing looks at."""
    token, share = torch.tensor([b[0] for b in before])[:, None], torch.tensor([b[1] for b in before])[:, None]
    ask = torch.tensor([a.ask if a else 0 for a in asked])[:, None]
    of = torch.tensor([a.of if a else 0 for a in asked])[:, None]
    where = torch.tensor([a.position if a else 0 for a in asked])[:, None].expand(3, -1, -1)
    return network.language_states(network.embed_decisions(token, share, ask, of), where, cache)[:, 0]


def _with_prior(p: Tensor, prior: np.ndarray) -> Tensor:
    """Probabilities (M, 3 or 4) of shapes, and of NOTHING, those of shapes weighted by prior (M, 3)."""
    real = p[:, :NOTHING]
    both = (real.log() + torch.from_numpy(prior).to(real).log()).softmax(-1) * real.sum(-1, keepdim=True)
    return torch.cat([both, p[:, NOTHING:]], -1)


def _picked(p: Tensor, sampling: Sampling, generator: torch.Generator) -> Tensor:
    """Indices (M,) by their probabilities (M, K): the likeliest, or of the nucleus."""
    if not sampling.temperature:
        return p.argmax(-1)
    ordered, order = (p.log() / sampling.temperature).softmax(-1).sort(-1, descending=True)
    ordered = ordered * (ordered.cumsum(-1) - ordered < sampling.top_p)
    return order.gather(1, torch.multinomial(ordered, 1, generator=generator))[:, 0]
