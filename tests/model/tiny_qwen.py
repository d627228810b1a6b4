"""A Qwen2.5-VL of a few million parameters: the architecture of the large one, at a size for a laptop."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from transformers import PreTrainedTokenizerBase, Qwen2_5_VLConfig, Qwen2_5_VLForConditionalGeneration


@dataclass(frozen=True)
class TinySize:
    """Widths and depths of the language model and of the vision tower."""

    hidden: int = 192
    layers: int = 4
    heads: int = 6
    intermediate: int = 512
    vision_hidden: int = 128
    vision_depth: int = 4
    vision_heads: int = 4
    vision_intermediate: int = 352
    patch: int = 16


def tiny_config(tokenizer: PreTrainedTokenizerBase, size: TinySize) -> Qwen2_5_VLConfig:
    """The configuration of a tiny model for the tokenizer; all vision blocks attend over the whole frame."""

    def token(text: str) -> int:
        id_ = tokenizer.convert_tokens_to_ids(text)
        assert isinstance(id_, int)
        return id_

    head_dim = size.hidden // size.heads
    section = head_dim // 2 // 3
    return Qwen2_5_VLConfig(
        text_config={
            "vocab_size": len(tokenizer),
            "hidden_size": size.hidden,
            "intermediate_size": size.intermediate,
            "num_hidden_layers": size.layers,
            "num_attention_heads": size.heads,
            "num_key_value_heads": size.heads,
            "max_position_embeddings": 4096,
            "tie_word_embeddings": True,
            "rope_parameters": {
                "rope_type": "default",
                "rope_theta": 10000.0,
                "mrope_section": [head_dim // 2 - 2 * section, section, section],
            },
            "bos_token_id": None,
            "eos_token_id": token("<|im_end|>"),
            "pad_token_id": token("<|endoftext|>"),
        },
        vision_config={
            "depth": size.vision_depth,
            "hidden_size": size.vision_hidden,
            "intermediate_size": size.vision_intermediate,
            "num_heads": size.vision_heads,
            "patch_size": size.patch,
            "spatial_merge_size": 2,
            "temporal_patch_size": 2,
            "out_hidden_size": size.hidden,
            "fullatt_block_indexes": list(range(size.vision_depth)),
            "window_size": 8 * size.patch,
            "tokens_per_second": 1,
        },
        image_token_id=token("<|image_pad|>"),
        video_token_id=token("<|video_pad|>"),
        vision_start_token_id=token("<|vision_start|>"),
        vision_end_token_id=token("<|vision_end|>"),
        tie_word_embeddings=True,
    )


def build_tiny(tokenizer: PreTrainedTokenizerBase, size: TinySize, seed: int) -> Qwen2_5_VLForConditionalGeneration:
    """A tiny model with random weights, float32."""
    torch.manual_seed(seed)
    return Qwen2_5_VLForConditionalGeneration(tiny_config(tokenizer, size))
