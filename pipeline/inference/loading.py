"""The model that answers, whatever it is shown: a vision-language model, or one that reads objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.objects.answering import ObjectsModel, load_objects
from pipeline.objects.checkpoint import is_objects

if TYPE_CHECKING:
    from pipeline.model.base import Base


def load_answering(
    name: str, width: int = 336, height: int = 224, frames: int = 10, dtype: str = "float32"
) -> Base | ObjectsModel:
    """The model in a folder, or of that name in the local hub cache; the arguments are those of `load_base`.

    Raises:
        ModelError: Where it cannot be loaded.
    """
    if is_objects(name):
        return load_objects(name, frames)
    from pipeline.model.base import load_base  # imports transformers, which takes seconds

    return load_base(name, width, height, frames, dtype)
