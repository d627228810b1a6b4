"""A base model by folder or hub name: weights, tokenizer, how clips are cut for it and what they show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch.nn import functional
from transformers import (
    AutoConfig,
    PreTrainedTokenizerBase,
    Qwen2_5_VLConfig,
    Qwen2_5_VLForConditionalGeneration,
)

from pipeline.model.checkpoint import (
    LOADING,
    LOADING_ERRORS,
    load_tokenizer,
    load_weights,
    read_layout,
    unavailable,
    write_layout,
)
from pipeline.model.constrained_decoding import TrieCache
from pipeline.model.language.codec import Codec
from pipeline.model.model_input import ModelInput, read_input, write_input
from pipeline.model.patches import PatchLayout


@dataclass
class Base:
    """A model ready for use.

    Attributes:
        model: The weights.
        tokenizer: Its own.
        layout: How clips are cut for it.
        codec: Prompts and completions as its tokens.
        input: What its pictures show, as it was trained; None where that was not recorded.
        name: The folder or hub name that it was loaded from.
    """

    model: Qwen2_5_VLForConditionalGeneration
    tokenizer: PreTrainedTokenizerBase
    layout: PatchLayout
    codec: Codec
    input: ModelInput | None = None
    name: str = ""

    def __post_init__(self) -> None:
        # Kernel and stride of the patch embedding are equal: a matrix product, several times faster than a
        # convolution on a CPU, with the same weights.
        embed = self.model.model.visual.patch_embed
        embed.forward = lambda x: functional.linear(x.to(embed.proj.weight.dtype), embed.proj.weight.flatten(1))

    @cached_property
    def tries(self) -> TrieCache:
        """The tokens that the grammar allows, for constrained decoding."""
        return TrieCache(self.codec)

    def save(self, folder: Path) -> None:
        """Weights (safetensors), configuration, tokenizer, clip layout and input, as `load_base` reads them."""
        self.model.save_pretrained(folder)
        self.tokenizer.save_pretrained(folder)
        write_layout(folder, self.layout)
        if self.input is not None:
            write_input(folder, self.input)


def load_base(name: str, width: int, height: int, frames: int, dtype: str) -> Base:
    """The model in a folder, or of that name in the local hub cache.

    Nothing is downloaded here.

    Args:
        name: A folder, or a hub name.
        width: px of the frames, for a model that does not bring its own layout.
        height: px of the frames, likewise.
        frames: That will be shown of a clip.
        dtype: Of the weights: "float32" or "bfloat16".

    Raises:
        ModelError: Says what to fetch where the weights are not at hand.
    """
    layout = read_layout(name, width, height, frames)
    tokenizer = load_tokenizer(name)
    try:
        kind = AutoConfig.from_pretrained(name, **LOADING).model_type
        if kind != Qwen2_5_VLConfig.model_type:
            raise ValueError(f"it is of the type {kind}, not {Qwen2_5_VLConfig.model_type}")
        model = load_weights(Qwen2_5_VLForConditionalGeneration, name, dtype=getattr(torch, dtype))
    except LOADING_ERRORS as error:
        raise unavailable(name, error) from None
    return Base(
        model=model,
        tokenizer=tokenizer,
        layout=layout,
        codec=Codec(tokenizer, layout.tokens),
        input=read_input(name),
        name=name,
    )
