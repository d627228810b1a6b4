"""The model that answers: the words model, or a vision-language model with a tokenizer of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.model.model_input import is_words

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel


def load_answering(
    name: str, width: int = 336, height: int = 224, frames: int = 10, dtype: str = "float32"
) -> Base | WordsModel:
    """The model in a folder, or of that name in the local hub cache; the arguments are those of `load_base`.

    Raises:
        ModelError: Where it cannot be loaded.
    """
    if is_words(name):
        from pipeline.model.words_model import load_words  # imports transformers, which takes seconds

        return load_words(name, frames)
    from pipeline.model.base import load_base

    return load_base(name, width, height, frames, dtype)
