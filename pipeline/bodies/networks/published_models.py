"""Published video segmenters, SAM 2 and EdgeTAM, loaded from a local folder through transformers.

Only their weights come from elsewhere: a folder with config.json and safetensors, as `save_pretrained` writes it.
Nothing is downloaded, and no code of the folder is run.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from pipeline.errors import ModelError, did_you_mean, naming
from pipeline.untrusted import read_json

CONFIG = "config.json"


@dataclass(frozen=True)
class Family:
    """model_type: in config.json. architecture: the class in transformers. example: a published checkpoint's name."""

    model_type: str
    architecture: str
    example: str


FAMILIES = {
    "sam2": Family("sam2_video", "Sam2VideoModel", "facebook/sam2.1-hiera-tiny"),
    "edgetam": Family("edgetam_video", "EdgeTamVideoModel", "yonigozlan/EdgeTAM-hf"),
}


@dataclass(frozen=True)
class PublishedSegmenter:
    """A model that follows prompted bodies through a clip. size: px, height and width of the pictures that it takes."""

    model: Any
    size: tuple[int, int]
    device: torch.device


def published_source(text: str) -> tuple[str, Path] | None:
    """Family and folder of `sam2:PATH` or `edgetam:PATH`; None where the text does not begin with a family's name."""
    family, colon, path = text.partition(":")
    if not colon or family not in FAMILIES:
        return None
    if not path:
        raise ModelError(f"{text!r} names no folder; valid: {family}:PATH, {_needed(family)}")
    return family, Path(path)


def load_published(family: str, folder: Path | str) -> PublishedSegmenter:
    """The model of a folder in float32, on the GPU where there is one.

    Raises ModelError where the folder is not one of this family's weights, or these are damaged or incomplete.
    """
    if family not in FAMILIES:
        valid = ", ".join(FAMILIES)
        raise ModelError(f"unknown segmenter {family!r}{did_you_mean(family, FAMILIES)}; valid: {valid}")
    folder = Path(folder)
    if not folder.is_dir():
        raise ModelError(f"{folder} is not a folder; {family}:PATH takes {_needed(family)}")
    if not (folder / CONFIG).is_file() or not any(folder.glob("*.safetensors")):
        raise ModelError(f"{folder} has no {CONFIG} with safetensors; {family}:PATH takes {_needed(family)}")
    model = _load(family, folder)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    side = model.config.image_size
    size = (side, side) if isinstance(side, int) else (side[0], side[1])
    return PublishedSegmenter(model.to(device).eval(), size, device)


def _load(family: str, folder: Path) -> Any:
    import transformers
    from safetensors import SafetensorError
    from transformers.utils import logging

    kind = FAMILIES[family]
    architecture = getattr(transformers, kind.architecture)
    try:
        stored = read_json(folder / CONFIG, ModelError)
        found = stored["model_type"]
    except (KeyError, ModelError) as error:
        raise ModelError(f"{folder / CONFIG} is not the configuration of a model: {_first_line(error)}") from error
    if found != kind.model_type:
        raise ModelError(f"{folder} holds a model of the type {found!r}; {family}:PATH takes {_needed(family)}")
    if family == "edgetam":
        from pipeline.bodies.networks.repvit import use_repvit

        with naming(str(folder / CONFIG)):
            stored = use_repvit(stored)
    logging.disable_progress_bar()
    before = logging.get_verbosity()
    logging.set_verbosity(logging.CRITICAL)  # what is missing is an error here, not a table of warnings
    try:
        model, loaded = architecture.from_pretrained(
            str(folder),
            config=architecture.config_class.from_dict(stored),
            local_files_only=True,
            use_safetensors=True,
            trust_remote_code=False,
            dtype=torch.float32,
            output_loading_info=True,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, SafetensorError) as error:
        raise ModelError(f"the weights in {folder} cannot be loaded: {_first_line(error)}") from error
    finally:
        logging.set_verbosity(before)
    missing = sorted(loaded["missing_keys"])
    if missing:
        raise ModelError(
            f"the weights in {folder} are incomplete: {len(missing)} are missing, {missing[0]} first; fetch the folder "
            "again"
        )
    return model


def _needed(family: str) -> str:
    kind = FAMILIES[family]
    return (
        f"a local folder with the {CONFIG} (model_type {kind.model_type}) and the safetensors of a checkpoint such as "
        f"{kind.example}; nothing is downloaded here"
    )


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return lines[0] if lines else type(error).__name__
