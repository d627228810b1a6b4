"""What a checkpoint has beside its weights: tokenizer and clip layout.

A checkpoint is a folder, or a name in the local hub cache; nothing is downloaded here.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from transformers import AutoConfig, AutoTokenizer, PreTrainedTokenizerBase
from transformers.utils import logging

from pipeline.errors import ModelError
from pipeline.model.patches import PatchLayout
from pipeline.untrusted import read_json

logging.disable_progress_bar()  # of reading weights, which takes a second

LAYOUT_FILE = "clip_layout.json"
#: Nothing is downloaded, and no code of a checkpoint is run.
LOADING: dict[str, Any] = {"local_files_only": True, "trust_remote_code": False}
LOADING_ERRORS = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    RuntimeError,
    ImportError,
    SafetensorError,
)
"""What transformers raises for checkpoints that are missing or damaged."""


def unavailable(name: str, error: Exception) -> ModelError:
    """The one sentence for a checkpoint that cannot be loaded."""
    fetch = name if "/" in name and not Path(name).exists() else "Qwen/Qwen2.5-VL-3B-Instruct"
    return ModelError(
        f"{name!r} is neither a folder with a Qwen2.5-VL checkpoint (config.json, model.safetensors, tokenizer.json) "
        f"nor in the local hub cache. Valid: models/words, or fetch it first on a machine with a network: hf download "
        f"{fetch}. ({(str(error).strip() or type(error).__name__).splitlines()[0]})"
    )


def load_tokenizer(name: str) -> PreTrainedTokenizerBase:
    """The checkpoint's tokenizer. Raises `ModelError`."""
    try:
        return AutoTokenizer.from_pretrained(name, **LOADING)
    except Exception as error:  # the tokenizers' own parser raises bare exceptions
        raise unavailable(name, error) from None


def load_weights(architecture: Any, name: str | Path, **settings: Any) -> Any:
    """A model of that class of transformers, with all its weights from safetensors.

    Attention is the library's own, whatever config.json says (it may name a package of the hub).

    Raises:
        ValueError: Weights are missing, which would be random, or have another shape; and others of `LOADING_ERRORS`.
    """
    settings |= LOADING | {"use_safetensors": True, "attn_implementation": "sdpa", "output_loading_info": True}
    model, loaded = architecture.from_pretrained(name, **settings)
    missing = sorted(loaded["missing_keys"])
    if missing:
        raise ValueError(f"{len(missing)} of its tensors are missing, {missing[0]} first")
    different = sorted(str(key) for key in loaded["mismatched_keys"])
    if different:
        raise ValueError(f"{len(different)} of its tensors have another shape, {different[0]} first")
    return model


def read_layout(name: str, width: int, height: int, frames: int) -> PatchLayout:
    """How clips are cut for the checkpoint: its own layout, else frames of width x height in its patches.

    Raises `ModelError` where the checkpoint is missing or its layout has another number of frames.
    """
    file = Path(name) / LAYOUT_FILE
    try:
        if file.is_file():
            stored: dict[str, Any] = read_json(file, ModelError)
            stored |= {key: tuple(stored[key]) for key in ("mean", "std")}
            layout = PatchLayout(**stored)
        else:
            vision = AutoConfig.from_pretrained(name, **LOADING).vision_config
            unit = vision.patch_size * vision.spatial_merge_size
            if width % unit or height % unit:
                raise ModelError(
                    f"{name!r} takes frames whose sides are multiples of {unit} px, not {width} x {height}"
                )
            layout = PatchLayout(
                width=width,
                height=height,
                frames=frames,
                patch=vision.patch_size,
                temporal=vision.temporal_patch_size,
                merge=vision.spatial_merge_size,
            )
    except LOADING_ERRORS as error:
        raise unavailable(name, error) from None
    if layout.frames != frames:
        raise ModelError(f"{name!r} was trained on {layout.frames} frames a clip; {frames} cannot be shown to it")
    return layout


def write_layout(folder: Path, layout: PatchLayout) -> None:
    (folder / LAYOUT_FILE).write_text(json.dumps(asdict(layout), indent=1) + "\n")
