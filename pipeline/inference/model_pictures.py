"""What the model is shown of a clip: pictures, or its bodies one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pipeline.model.model_input import ModelInput
from pipeline.model.patches import PatchLayout, fit_layout
from pipeline.model.shown import seen_clip
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px

if TYPE_CHECKING:
    from pipeline.model.answering import Shown
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel


def model_pictures(
    model_input: ModelInput, layout: PatchLayout, flow: np.ndarray, frames: np.ndarray, interval: float
) -> np.ndarray:
    """The pictures that a model takes, as it was trained.

    Args:
        model_input: How the checkpoint's input is made.
        layout: The checkpoint's.
        flow: (P, h, w, 2), px per interval, of the model's pairs of frames.
        frames: (P, h, w, 3) uint8, the first frame of each pair.
        interval: s between the two frames of a pair.

    Returns:
        (P, H, W, 3) uint8 in the layout's size.
    """
    if model_input.input == "rgb":
        return fit_layout(frames, layout)
    assert model_input.picture is not None
    shown = flow_picture(flow, model_input.picture, scaled_max_px(flow.shape[2], interval))
    return fit_layout(shown, layout)


def shown_clip(
    base: Base | WordsModel,
    model_input: ModelInput,
    flow: np.ndarray,
    frames: np.ndarray,
    masks: np.ndarray,
    interval: float,
    shape_prior: np.ndarray | None = None,
) -> Shown:
    """What a model takes of a clip.

    Args:
        base: The model.
        model_input: How its input is made.
        flow: (P, h, w, 2), px per interval, of the model's pairs of frames.
        frames: (P, h, w, 3) uint8, the first frame of each pair.
        masks: (P, h, w) uint8, its masks.
        interval: s between the two frames of a pair.
        shape_prior: (N, 3) probability of each of `BASIC_SHAPES` for the masks' bodies, for the words model.
    """
    from pipeline.model.answering import as_shown
    from pipeline.model.words_model import WordsModel

    if isinstance(base, WordsModel) or model_input.sees == "bodies":
        return as_shown(base, seen_clip(model_input.input, model_input.sees, masks, flow, frames, shape_prior))
    return model_pictures(model_input, base.layout, flow, frames, interval)
