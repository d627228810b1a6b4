"""Bodies that are prompted in one frame, followed through a clip by a published video segmenter.

The model's video processor needs torchvision, so the frames are resized and normalised here, and the state of the
inference session is filled here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from pipeline.bodies.networks.published_models import PublishedSegmenter
from pipeline.vision.recordings.mask_file import MOST_BODIES

#: Of the pictures that SAM 2 and EdgeTAM were trained with (ImageNet's), for channels in 0 to 1.
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
INSIDE, CORNERS = 1, (2, 3)  # labels of points: on the body; first and last corner of a box
FREE_PX = 3  # a body whose mask is nearer to another's, or to the border, may be seen in part
_BODY = 1  # the id of a session's only body


@dataclass(frozen=True)
class Prompt:
    """What shows one body in one frame: a mask, or points, or a box, or points in a box.

    Attributes:
        frame: Of the clip.
        mask: (H, W) bool of that frame.
        points: (K, 2) px of the clip, x and y, on the body.
        box: (4,) px, x and y of the first corner and of the last.
    """

    frame: int
    mask: np.ndarray | None = None
    points: np.ndarray | None = None
    box: np.ndarray | None = None

    def __post_init__(self) -> None:
        if (self.mask is None) == (self.points is None and self.box is None):
            raise ValueError("a prompt has either a mask, or points or a box")


def body_prompts(masks: np.ndarray) -> list[Prompt]:
    """The mask of each body of ids (T, H, W) uint8 in the frame in which it is seen best, in the order of the ids.

    That is the frame with the largest mask that also the frames beside it have, of those in which it touches neither
    the border nor another body, where there are any.
    """
    count = len(masks)
    prompts = []
    for body in np.unique(masks[masks > 0]):
        own = masks == body
        area = own.sum((1, 2))
        steady = np.minimum.reduce([area[np.clip(np.arange(count) + step, 0, count - 1)] for step in (-1, 0, 1)])
        free = np.array([_is_free(frame, body) for frame in masks])
        rank = np.lexsort((area, steady, free & (area > 0)))
        best = int(rank[-1])
        prompts.append(Prompt(best, mask=own[best]))
    return prompts


def _is_free(mask: np.ndarray, body: int) -> bool:
    """Whether a body of ids (H, W) lies apart from other bodies and from the border."""
    own = np.pad((mask == body).astype(np.uint8), FREE_PX)
    other = np.pad((mask != body) & (mask > 0), FREE_PX, constant_values=True)
    return not (cv2.dilate(own, np.ones((2 * FREE_PX + 1,) * 2, np.uint8)) > 0)[other].any()


@torch.inference_mode()
def segment_with(segmenter: PublishedSegmenter, frames: np.ndarray, prompts: Sequence[Prompt]) -> np.ndarray:
    """Follow bodies from the frames in which they are prompted to the clip's ends.

    Args:
        segmenter: Of `load_published`.
        frames: (T, H, W, 3) uint8 RGB.
        prompts: One for each body, at most MOST_BODIES.

    Returns:
        (T, H, W) uint8, 0 for the background and k + 1 for the body of prompt k. Where two bodies claim a pixel, the
        one with the higher logit has it.
    """
    count, height, width = frames.shape[:3]
    if len(prompts) > MOST_BODIES:
        raise ValueError(f"{len(prompts)} prompts; valid: at most {MOST_BODIES}")
    out = np.zeros((count, height, width), np.uint8)
    best = np.zeros((count, height, width), np.float32)
    if not prompts:
        return out
    pictures = packed(frames, segmenter.size)
    features = _features(segmenter, pictures)
    for k, prompt in enumerate(prompts, 1):
        if not 0 <= prompt.frame < count:
            raise ValueError(f"frame {prompt.frame} is prompted; valid: 0 to {count - 1}")
        for t, logits in _follow(segmenter, pictures, features, prompt, (height, width)).items():
            better = logits > best[t]
            out[t][better] = k
            best[t][better] = logits[better]
    return out


def packed(frames: np.ndarray, size: tuple[int, int]) -> Tensor:
    """Frames (T, H, W, 3) uint8 as the model takes them: (T, 3, h, w) float32 of size (h, w), normalised."""
    height, width = size
    mode = cv2.INTER_AREA if frames.shape[1] > height and frames.shape[2] > width else cv2.INTER_LINEAR
    small = np.stack([cv2.resize(frame, (width, height), interpolation=mode) for frame in frames])
    pictures = (small.astype(np.float32) / 255 - np.array(MEAN, np.float32)) / np.array(DEVIATION, np.float32)
    return torch.from_numpy(np.ascontiguousarray(pictures.transpose(0, 3, 1, 2)))


def _features(segmenter: PublishedSegmenter, pictures: Tensor) -> list[dict[str, Any]]:
    """What the model sees in each frame, for all bodies. The encodings of position are those of every frame."""
    out: list[dict[str, Any]] = []
    for picture in pictures:
        seen = segmenter.model.get_image_features(picture[None].to(segmenter.device), return_dict=True)
        position = out[0]["vision_pos_embeds"] if out else list(seen.fpn_position_encoding)
        out.append({"vision_feats": list(seen.fpn_hidden_states), "vision_pos_embeds": position})
    return out


def _follow(
    segmenter: PublishedSegmenter,
    pictures: Tensor,
    features: list[dict[str, Any]],
    prompt: Prompt,
    size: tuple[int, int],
) -> dict[int, np.ndarray]:
    """Logits (H, W) of one body in each frame, forwards from its prompt and then backwards."""
    model = segmenter.model
    module = import_module(type(model).__module__)
    session = getattr(module, type(model).__name__.replace("Model", "InferenceSession"))(
        video=pictures,
        video_height=size[0],
        video_width=size[1],
        inference_device=segmenter.device,
        inference_state_device=segmenter.device,
        dtype=torch.float32,
        max_vision_features_cache_size=len(pictures),
    )
    for t, seen in enumerate(features):
        session.cache.cache_vision_features(t, seen)
    index = session.obj_id_to_idx(_BODY)
    if prompt.mask is not None:
        session.add_mask_inputs(index, prompt.frame, _resized_mask(prompt.mask, segmenter.size))
    else:
        session.add_point_inputs(index, prompt.frame, _scaled_points(prompt, size, segmenter.size))
    session.obj_with_new_inputs = [_BODY]
    logits = {}
    for backwards in (False, True):
        for answer in model.propagate_in_video_iterator(session, start_frame_idx=prompt.frame, reverse=backwards):
            large = functional.interpolate(answer.pred_masks.float(), size, mode="bilinear", align_corners=False)
            logits[answer.frame_idx] = large[0, 0].cpu().numpy()
    return logits


def _resized_mask(mask: np.ndarray, size: tuple[int, int]) -> Tensor:
    """A mask (H, W) bool as the model takes it: (1, 1, h, w) of 0 and 1. A body of few pixels stays."""
    given = torch.from_numpy(np.ascontiguousarray(mask, np.float32))[None, None]
    soft = functional.interpolate(given, size, mode="bilinear", align_corners=False, antialias=True)
    return (soft >= min(0.5, float(soft.max()))).float()


def _scaled_points(prompt: Prompt, size: tuple[int, int], model_size: tuple[int, int]) -> dict[str, Tensor]:
    """Points and corners in px of the model's pictures, with their labels."""
    points = np.zeros((0, 2)) if prompt.points is None else np.reshape(prompt.points, (-1, 2))
    labels = np.full(len(points), INSIDE)
    if prompt.box is not None:
        points = np.concatenate([np.reshape(prompt.box, (2, 2)), points])
        labels = np.concatenate([CORNERS, labels])
    scale = np.array([model_size[1] / size[1], model_size[0] / size[0]])
    return {
        "point_coords": torch.tensor(points * scale, dtype=torch.float32)[None, None],
        "point_labels": torch.tensor(labels, dtype=torch.int32)[None, None],
    }
