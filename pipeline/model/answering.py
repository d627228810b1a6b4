"""The model that answers: the words model, or a vision-language model with a tokenizer of its own.

Neither is imported before it is needed: transformers takes seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from pipeline.model.model_input import is_words
from pipeline.model.sampling import Completed, Sampling
from pipeline.model.shown import SeenBodies, SeenFrames

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.generate import Prompt
    from pipeline.model.question import Question
    from pipeline.model.words_model import WordsModel

#: What a model is shown of a clip: bodies or frames for the words model; for another one pictures (T, H, W, 3) uint8 in
#: its layout, or a question about bodies.
Shown: TypeAlias = "np.ndarray | SeenBodies | SeenFrames | Question"


def load_answering(
    name: str, width: int = 336, height: int = 224, frames: int = 10, dtype: str = "float32"
) -> Base | WordsModel:
    """The model in a folder, or of that name in the local hub cache; the arguments are those of `load_base`.

    Raises:
        ModelError: Where it cannot be loaded.
    """
    if is_words(name):
        from pipeline.model.words_model import load_words

        return load_words(name, frames)
    from pipeline.model.base import load_base

    return load_base(name, width, height, frames, dtype)


def as_shown(model: Base | WordsModel, seen: SeenBodies | SeenFrames) -> Shown:
    """What a model takes of bodies: the words model as they are, another one as a question; or of frames (words)."""
    from pipeline.model.words_model import WordsModel

    if isinstance(model, WordsModel):
        return seen
    from pipeline.model.question import question_about

    assert isinstance(seen, SeenBodies), "a model with a tokenizer takes frames as pictures in its layout"
    return question_about(model, seen)


def write(
    model: Base | WordsModel,
    shown: Sequence[Shown],
    sampling: Sampling,
    seeds: Sequence[int],
    prompt: Prompt | None = None,
) -> list[list[Completed]]:
    """Completions of clips, `sampling.samples` of each; prompt: with worked examples, None for the question alone."""
    from pipeline.model.words_model import WordsModel, write_answers

    if isinstance(model, WordsModel):
        assert prompt is None, "the words model takes no worked examples"
        seen = [one for one in shown if isinstance(one, SeenBodies | SeenFrames)]
        return [write_answers(model, one, sampling, seed) for one, seed in zip(seen, seeds, strict=True)]
    from pipeline.model.generate import answer_question, generate
    from pipeline.model.question import Question

    asked = [one for one in shown if isinstance(one, Question)]
    if asked:  # one by one, since their lengths differ
        assert prompt is None, "a question about bodies takes no worked examples"
        return [answer_question(model, one, sampling, seed) for one, seed in zip(asked, seeds, strict=True)]
    pictures = np.stack([one for one in shown if isinstance(one, np.ndarray)])
    return generate(model, pictures, sampling, list(seeds), prompt)
