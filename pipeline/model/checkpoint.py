"""What a checkpoint has beside its weights: tokenizer and clip layout.

A checkpoint is a folder, or a name in the local hub cache; nothing is downloaded here.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from transformers import AutoConfig, AutoTokenizer, PreTrainedTokenizerBase

from pipeline.errors import ModelError
from pipeline.model.patches import PatchLayout

LAYOUT_FILE = "clip_layout.json"


def unavailable(name: str, error: Exception) -> ModelError:
    """The one sentence for a checkpoint that cannot be loaded."""
    fetch = name if "/" in name and not Path(name).exists() else "Qwen/Qwen2.5-VL-3B-Instruct"
    return ModelError(
        f"{name!r} is neither a folder with a Qwen2.5-VL checkpoint (config.json, model.safetensors, tokenizer.json) "
        f"nor in the local hub cache. Valid: models/tiny, or fetch it first on a machine with a network: hf download "
        f"{fetch}. ({str(error).splitlines()[0]})"
    )


def load_tokenizer(name: str) -> PreTrainedTokenizerBase:
    """The checkpoint's tokenizer. Raises `ModelError`."""
    try:
        return AutoTokenizer.from_pretrained(name, local_files_only=True)
    except (OSError, ValueError, KeyError) as error:
        raise unavailable(name, error) from None


def read_layout(name: str, width: int, height: int, frames: int) -> PatchLayout:
    """How clips are cut for the checkpoint: its own layout, else frames of width x height in its patches.

    Raises `ModelError` where the checkpoint is missing or its layout has another number of frames.
    """
    file = Path(name) / LAYOUT_FILE
    try:
        if file.is_file():
            stored: dict[str, Any] = json.loads(file.read_text())
            stored |= {key: tuple(stored[key]) for key in ("mean", "std")}
            layout = PatchLayout(**stored)
        else:
            vision = AutoConfig.from_pretrained(name, local_files_only=True).vision_config
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
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise unavailable(name, error) from None
    if layout.frames != frames:
        raise ModelError(f"{name!r} was trained on {layout.frames} frames a clip; {frames} cannot be shown to it")
    return layout


def write_layout(folder: Path, layout: PatchLayout) -> None:
    (folder / LAYOUT_FILE).write_text(json.dumps(asdict(layout), indent=1) + "\n")
