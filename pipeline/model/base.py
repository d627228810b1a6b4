"""A base model by folder or hub name: weights, tokenizer and how clips are cut for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError
from torch.nn import functional
from transformers import (
    AutoConfig,
    PreTrainedTokenizerBase,
    Qwen2_5_VLConfig,
    Qwen2_5_VLForConditionalGeneration,
)
from transformers.utils import logging

from pipeline.language.codec import Codec
from pipeline.model.checkpoint import load_tokenizer, read_layout, unavailable, write_layout
from pipeline.model.patches import PatchLayout

logging.disable_progress_bar()


@dataclass
class Base:
    """A model ready for use. `layout` and `codec` belong to the model as it was trained."""

    model: Qwen2_5_VLForConditionalGeneration
    tokenizer: PreTrainedTokenizerBase
    layout: PatchLayout
    codec: Codec

    def __post_init__(self) -> None:
        # Kernel and stride of the patch embedding are equal: a matrix product, several times faster than a
        # convolution on a CPU, with the same weights.
        embed = self.model.model.visual.patch_embed
        embed.forward = lambda x: functional.linear(x.to(embed.proj.weight.dtype), embed.proj.weight.flatten(1))

    def save(self, folder: Path) -> None:
        """Weights (safetensors), configuration, tokenizer and clip layout, in the form that `load_base` reads."""
        self.model.save_pretrained(folder)
        self.tokenizer.save_pretrained(folder)
        write_layout(folder, self.layout)


def load_base(name: str, width: int = 336, height: int = 224, frames: int = 10, dtype: str = "float32") -> Base:
    """The model in a folder, or of that name in the local hub cache.

    width, height: px of the frames for a model that does not bring its own layout. Raises `ModelError` that says what
    to fetch where the weights are not at hand; nothing is downloaded here.
    """
    layout = read_layout(name, width, height, frames)
    tokenizer = load_tokenizer(name)
    try:
        kind = AutoConfig.from_pretrained(name, local_files_only=True).model_type
        if kind != Qwen2_5_VLConfig.model_type:
            raise ValueError(f"it is of the type {kind}, not {Qwen2_5_VLConfig.model_type}")
        model = Qwen2_5_VLForConditionalGeneration.from_pretrained(
            name, local_files_only=True, dtype=getattr(torch, dtype)
        )
    except (OSError, ValueError, KeyError, SafetensorError) as error:
        raise unavailable(name, error) from None
    return Base(model, tokenizer, layout, Codec(tokenizer, layout.tokens))
