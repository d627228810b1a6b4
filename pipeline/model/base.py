"""A base model by folder or hub name: weights, tokenizer and how clips are cut for it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch.nn import functional
from transformers import AutoTokenizer, PreTrainedTokenizerBase, Qwen2_5_VLForConditionalGeneration

from pipeline.errors import ModelError
from pipeline.language.codec import Codec
from pipeline.model.patches import PatchLayout

LAYOUT_FILE = "clip_layout.json"


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
        (folder / LAYOUT_FILE).write_text(json.dumps(asdict(self.layout), indent=1) + "\n")


def load_base(name: str, width: int = 336, height: int = 224, frames: int = 10, dtype: str = "float32") -> Base:
    """The model in a folder, or of that name in the local hub cache.

    width, height, frames: clip layout for a model that does not bring its own. Raises `ModelError` that says what
    to fetch where the weights are not at hand; nothing is downloaded here.
    """
    try:
        tokenizer = AutoTokenizer.from_pretrained(name, local_files_only=True)
        model = Qwen2_5_VLForConditionalGeneration.from_pretrained(
            name, local_files_only=True, dtype=getattr(torch, dtype)
        )
    except (OSError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise ModelError(
            f"model.base: {name!r} is neither a folder with a Qwen2.5-VL checkpoint (config.json, model.safetensors, "
            f"tokenizer.json) nor in the local hub cache. Valid: models/tiny, or fetch the weights first: "
            f"hf download {name if '/' in name else 'Qwen/Qwen2.5-VL-3B-Instruct'}. ({reason})"
        ) from None
    layout = _layout(Path(name), model, width, height, frames)
    return Base(model, tokenizer, layout, Codec(tokenizer, layout.tokens))


def _layout(folder: Path, model: Qwen2_5_VLForConditionalGeneration, width: int, height: int, frames: int) -> PatchLayout:
    if (folder / LAYOUT_FILE).is_file():
        stored = json.loads((folder / LAYOUT_FILE).read_text())
        return PatchLayout(**{k: tuple(v) if isinstance(v, list) else v for k, v in stored.items()})
    vision = model.config.vision_config
    return PatchLayout(width, height, frames, vision.patch_size, vision.temporal_patch_size, vision.spatial_merge_size)
