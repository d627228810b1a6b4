"""What a model with a tokenizer is asked about bodies: a short video of each, with its place in each frame as text."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.model.base import Base
from pipeline.model.instances import FULL
from pipeline.model.language.completion import MAX_OBJECTS
from pipeline.model.shown import SeenBodies, most_seen, no_bodies


@dataclass(frozen=True)
class Question:
    """ids (P,) of the prompt; videos (S, T, H, W, 3) uint8 that it shows, in order."""

    ids: tuple[int, ...]
    videos: np.ndarray


def question_about(base: Base, seen: SeenBodies) -> Question:
    """The question about a clip's bodies, of at most MAX_OBJECTS: those that are seen in most frames.

    Raises:
        ModelError: Where there are none.
    """
    if not len(seen.instances):
        raise no_bodies()
    seen = most_seen(seen, MAX_OBJECTS)
    texts = [body_text(k + 1, place) for k, place in enumerate(seen.instances.places)]
    return Question(tuple(base.codec.bodies_ids(texts)), crop_pictures(seen, base.layout.width))


def body_text(number: int, places: np.ndarray) -> str:
    """What the prompt says of a body in words: box, px of 240x160, and mean flow, px per interval, of each frame.

    places: (T, 14) of `PLACES`.
    """
    frames = []
    for seen, left, right, top, bottom, _, _, _, right_flow, down_flow, *_ in places.tolist():
        box = f"{left:.0f} {top:.0f} {right:.0f} {bottom:.0f}, moves {right_flow:.1f} {down_flow:.1f}"
        frames.append(box if seen else "unseen")
    return f"body {number}: {'; '.join(frames)}\n"


def crop_pictures(seen: SeenBodies, side: int) -> np.ndarray:
    """(N, T, side, side, 3) uint8 of each body.

    Flow: red to the right, green down, blue the body less others. Colours: dimmed outside of the body.
    """
    crops = seen.crops.astype(np.float32) / FULL  # N, T, C, S, S
    if seen.colours is None:
        shown = crops
    else:
        shown = crops[:, :, :3] * np.where(crops[:, :, 3:] > 0.5, 1.0, 0.5)
    pictures = np.rint(127.5 * (shown + 1)).astype(np.uint8).transpose(0, 1, 3, 4, 2)
    flat = pictures.reshape(-1, *pictures.shape[2:])
    resized = np.stack([cv2.resize(p, (side, side), interpolation=cv2.INTER_LINEAR) for p in flat])
    return resized.reshape(*pictures.shape[:2], side, side, 3)
