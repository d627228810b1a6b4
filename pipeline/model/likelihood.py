"""The probability that a model gives to a completion under the grammar.

Tokens that the grammar forces (keys, punctuation, a token that alone may stand in its place) count as certain; the
model's distribution over the others is the one from which `pipeline.model.generate` draws at temperature 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from pipeline.model.base import Base
from pipeline.model.constrained_decoding import GrammarState
from pipeline.model.forward import hidden_states, right_padded
from pipeline.model.language.completion import completion_grammar


@dataclass(frozen=True)
class ConstrainedTokens:
    """A completion as tokens, with what else could have been written.

    Attributes:
        ids: (L,) of prompt, completion and end.
        free: (C,) The places in ids where the model had a choice.
        allowed: For each of these places, the tokens among which it chose.
    """

    ids: np.ndarray
    free: np.ndarray
    allowed: tuple[tuple[int, ...], ...]


def constrained_tokens(
    base: Base, completion: str, reasoning: bool, seconds: float, prompt: Sequence[int] | None = None
) -> ConstrainedTokens:
    """A completion's tokens, behind the ids of a prompt or the bare one. Raises `GrammarError` for a text that the
    grammar does not generate."""
    tokens = base.codec.encode(completion, reasoning, seconds)
    if prompt is not None:
        tokens = tokens.behind(prompt)
    state = GrammarState(completion_grammar(reasoning, seconds), base.codec, base.tries)
    place = tokens.prompt_length + len(state.forced())
    free, allowed = [], []
    while not state.finished:
        free.append(place)
        allowed.append(tuple(state.allowed))
        state.take(int(tokens.ids[place]))
        place += 1 + len(state.forced())
    return ConstrainedTokens(tokens.ids, np.array(free), tuple(allowed))


def log_probabilities(base: Base, written: Sequence[ConstrainedTokens], videos: torch.Tensor) -> torch.Tensor:
    """(B,) log-probabilities, nats, of completions: sums over their free tokens, each among those allowed there.

    videos: (V, T, H, W, 3) uint8, that the prompts show, in order.
    """
    device = base.model.device
    ids = right_padded([w.ids for w in written], base.codec.pad_id).to(device)
    row = torch.as_tensor(np.repeat(np.arange(len(written)), [len(w.free) for w in written]), device=device)
    free = torch.as_tensor(np.concatenate([w.free for w in written]), device=device)
    scores = base.model.lm_head(hidden_states(base, ids, videos)[row, free - 1]).float()  # (C, V)
    sets = {allowed: k for k, allowed in enumerate(dict.fromkeys(a for w in written for a in w.allowed))}
    forbidden = torch.ones(len(sets), scores.shape[1], dtype=torch.bool)
    for allowed, k in sets.items():
        forbidden[k, list(allowed)] = False
    which = torch.tensor([sets[a] for w in written for a in w.allowed])
    scores = scores.masked_fill(forbidden[which].to(device), -torch.inf)
    chosen = scores.log_softmax(-1).gather(1, ids[row, free][:, None])[:, 0]
    return torch.zeros(len(written), device=device).index_add(0, row, chosen)
