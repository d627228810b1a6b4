"""What a model reads before it writes: a question about a clip, after worked examples where there are any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.model.base import Base


@dataclass(frozen=True)
class Prompt:
    """ids (P,); videos (S, T, H, W, 3) uint8 of the worked examples in order, behind which the clip's own comes."""

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
