"""Completions of clips, greedy or sampled, in batches with a key-value cache, under the grammar: all of them parse.

Words are chosen token by token. Of a number, a greedy answer has the median of the model's distribution, and a sample a
quantile from its middle part, the same for all of its tokens: the likeliest first token is a poor guess at a number
where the model is not sure, and tokens drawn one by one are often far out (docs/decisions.md).

The prompt of a clip is run once; its samples share the cache. Rows advance together: tokens that the grammar forces are
fed in one pass, as far as they reach in every row, so that most forward passes end in a choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from transformers import DynamicCache

from pipeline.model.base import Base
from pipeline.model.constrained_decoding import GrammarState
from pipeline.model.forward import rotary_positions, video_inputs
from pipeline.model.language.completion import completion_grammar
from pipeline.model.question import Question
from pipeline.model.sampling import Completed, Sampling


@dataclass(frozen=True)
class Prompt:
    """ids (P,); videos (S, T, H, W, 3) uint8 before the last one that it shows, in order: of worked examples, or of the
    clip's other bodies."""

    ids: tuple[int, ...]
    videos: np.ndarray


def bare_prompt(base: Base) -> Prompt:
    """The question alone, on which models are fine-tuned."""
    layout = base.layout
    return Prompt(tuple(base.codec.prompt_ids), np.zeros((0, layout.frames, layout.height, layout.width, 3), np.uint8))


def few_shot_prompt(
    base: Base, instructions: str, videos: np.ndarray, completions: Sequence[str], reasoning: bool, seconds: float
) -> Prompt:
    """Instructions, then for each of the examples its video (S, T, H, W, 3) uint8 and its completion, then the
    question. Raises `GrammarError` for a completion that the grammar does not generate."""
    assert len(videos) == len(completions)
    return Prompt(tuple(base.codec.few_shot_ids(instructions, completions, reasoning, seconds)), videos)


def answer_question(base: Base, question: Question, sampling: Sampling, seed: int) -> list[Completed]:
    """Completions of one clip of whose bodies is asked."""
    (answers,) = generate(base, question.videos[-1:], sampling, [seed], Prompt(question.ids, question.videos[:-1]))
    return answers


@torch.no_grad()
def generate(
    base: Base, clips: np.ndarray, sampling: Sampling, seeds: list[int], prompt: Prompt | None = None
) -> list[list[Completed]]:
    """Completions of clips.

    Args:
        base: The model.
        clips: (B, T, H, W, 3) uint8, in the model's layout.
        sampling: How many of each clip, and how they are drawn.
        seeds: (B,) One a clip, which makes its completions repeatable.
        prompt: With worked examples; left out, the question alone.

    Returns:
        For each clip its `sampling.samples` completions.
    """
    model, device = base.model.eval(), base.model.device
    each = sampling.samples
    rows = len(clips) * each
    prompt = prompt or bare_prompt(base)
    where = rotary_positions(base, torch.tensor([prompt.ids]))[:, 0]
    cache, logits = _prefill(base, prompt, where, clips)
    cache.batch_repeat_interleave(each)
    logits = logits.repeat_interleave(each, 0)
    states = [
        GrammarState(completion_grammar(sampling.reasoning, sampling.seconds), base.codec, base.tries)
        for _ in range(rows)
    ]
    rngs = [np.random.default_rng((seeds[i // each], i % each)) for i in range(rows)]
    log_probability = np.zeros(rows)
    waiting: list[list[int]] = [s.forced() for s in states]  # tokens that are settled but not yet fed
    next_position = int(where.max()) + 1
    fed = 0
    while True:
        for i, state in enumerate(states):
            if not waiting[i] and not state.finished:
                log_p = _log_softmax(logits[i][state.allowed])
                if state.numeric and sampling.numbers == "quantiles":
                    if state.quantile is None:
                        state.quantile = _any_quantile(sampling, rngs[i])
                    pick, state.quantile = at_quantile(np.exp(log_p), state.quantile)
                else:
                    pick = _drawn(log_p, sampling, rngs[i]) if sampling.temperature else int(np.argmax(log_p))
                log_probability[i] += log_p[pick]
                token = state.allowed[pick]
                state.take(token)
                waiting[i] = [token, *state.forced()]
        if not any(waiting):
            break
        # rows that are done are fed padding, which nothing of theirs looks at again
        step = min(len(w) for w in waiting if w)
        ids = [(w[:step] or [base.codec.pad_id] * step) for w in waiting]
        waiting = [w[step:] for w in waiting]
        following = torch.arange(next_position + fed, next_position + fed + step, device=device).expand(3, rows, -1)
        out = model(
            input_ids=torch.tensor(ids, device=device),
            position_ids=following,
            past_key_values=cache,
            use_cache=True,
            logits_to_keep=1,
        )
        logits = out.logits[:, -1].float().cpu()
        fed += step
        assert fed < sampling.most_tokens, "the grammar's texts are finite"
    done = [Completed(s.text, float(p)) for s, p in zip(states, log_probability, strict=True)]
    return [done[i * each : (i + 1) * each] for i in range(len(clips))]


def _prefill(base: Base, prompt: Prompt, where: torch.Tensor, clips: np.ndarray) -> tuple[DynamicCache, torch.Tensor]:
    """Cache and last logits after the prompt, with positions `where` (3, P), of each clip."""
    device = base.model.device
    ids = torch.tensor([prompt.ids] * len(clips), device=device)
    videos = np.concatenate([np.concatenate([prompt.videos, clip[None]]) for clip in clips])
    patches, grid = video_inputs(base, torch.as_tensor(videos))
    cache = DynamicCache(config=base.model.config.get_text_config())
    out = base.model(
        input_ids=ids,
        pixel_values_videos=patches,
        video_grid_thw=grid,
        position_ids=where[:, None].expand(-1, len(clips), -1).to(device),
        past_key_values=cache,
        use_cache=True,
        logits_to_keep=1,
    )
    return cache, out.logits[:, -1].float().cpu()


def at_quantile(p: np.ndarray, quantile: float) -> tuple[int, float]:
    """Of probabilities (N,) of intervals in ascending order, the one in which a quantile of the whole lies, and which
    quantile of that interval it is. Followed from the first token of a number to its last, this leads to the number's
    quantile past no other number."""
    reached = np.cumsum(p)
    pick = min(int(np.searchsorted(reached, quantile)), len(p) - 1)
    return pick, float(np.clip((quantile - reached[pick]) / p[pick] + 1, 0, 1))


def _log_softmax(scores: torch.Tensor) -> np.ndarray:
    log_p = scores.double().numpy()
    log_p = log_p - log_p.max()
    return log_p - np.log(np.exp(log_p).sum())


def _any_quantile(sampling: Sampling, rng: np.random.Generator) -> float:
    return 0.5 + sampling.middle * (rng.random() - 0.5) if sampling.temperature else 0.5


def _drawn(log_p: np.ndarray, sampling: Sampling, rng: np.random.Generator) -> int:
    """An index at random, of the nucleus."""
    p = np.exp((log_p - log_p.max()) / sampling.temperature)
    p /= p.sum()
    order = np.argsort(-p, kind="stable")
    kept = order[: int(np.searchsorted(np.cumsum(p[order]), sampling.top_p)) + 1]
    return int(rng.choice(kept, p=p[kept] / p[kept].sum()))
