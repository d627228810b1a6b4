"""The choices in a completion, and the probability that a model gives to them under the grammar.

What the grammar forces (keys, punctuation, a token that alone may stand in its place) has no probability. It is the
distribution from which `pipeline.model.generate` draws at temperature 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from pipeline.language.completion import completion_grammar
from pipeline.model.base import Base
from pipeline.model.forward import hidden_states
from pipeline.model.inputs import right_padded
from pipeline.model.walker import Tries, Walker


@dataclass(frozen=True)
class Choices:
    """ids (L,) of prompt, completion and end; at (C,): the places in ids where the model chose; allowed: the tokens
    among which it did, for each of them."""

    ids: np.ndarray
    at: np.ndarray
    allowed: tuple[tuple[int, ...], ...]


def choices_in(base: Base, completion: str, reasoning: bool, seconds: float, tries: Tries) -> Choices:
    """The choices of a completion. Raises `GrammarError` for a text that the grammar does not generate."""
    tokens = base.codec.encode(completion, reasoning, seconds)
    walker = Walker(completion_grammar(reasoning, seconds), base.codec, tries)
    place = tokens.prompt_length + len(walker.forced())
    at, allowed = [], []
    while not walker.finished:
        at.append(place)
        allowed.append(tuple(walker.allowed))
        walker.take(int(tokens.ids[place]))
        place += 1 + len(walker.forced())
    return Choices(tokens.ids, np.array(at), tuple(allowed))


def log_probabilities(base: Base, written: Sequence[Choices], clips: torch.Tensor) -> torch.Tensor:
    """(B,) log-probabilities, nats, of completions of clips (B, T, H, W, 3) uint8: sums over their choices, each among
    the tokens that are allowed there."""
    device = base.model.device
    ids = right_padded([w.ids for w in written], base.codec.pad_id).to(device)
    row = torch.as_tensor(np.repeat(np.arange(len(written)), [len(w.at) for w in written]), device=device)
    at = torch.as_tensor(np.concatenate([w.at for w in written]), device=device)
    scores = base.model.lm_head(hidden_states(base, ids, clips)[row, at - 1]).float()  # (C, V)
    sets = {allowed: k for k, allowed in enumerate(dict.fromkeys(a for w in written for a in w.allowed))}
    forbidden = torch.ones(len(sets), scores.shape[1], dtype=torch.bool)
    for allowed, k in sets.items():
        forbidden[k, list(allowed)] = False
    which = torch.tensor([sets[a] for w in written for a in w.allowed])
    scores = scores.masked_fill(forbidden[which].to(device), -torch.inf)
    chosen = scores.log_softmax(-1).gather(1, ids[row, at][:, None])[:, 0]
    return torch.zeros(len(written), device=device).index_add(0, row, chosen)
