"""Sharp outlines: each body is looked at once more in each frame, in a square at its own scale."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from pipeline.bodies.networks.outline_network import SIDE, OutlineNetwork
from pipeline.bodies.networks.plate import clear_plate
from pipeline.bodies.networks.upsampling import SMOOTHNESS, guided_filter

MARGIN, LEAST_SIDE_PX = 1.6, 14  # side of a square: so many times the body's extent, and at least
BATCH = 64
CONTRAST = 4.0  # factor of the difference to the background
LEVEL = 0.4  # of the network's probability, at an outline: people draw blurred bodies with their blur
GUIDE_REACH = 2.0  # px of a square: radius of the filter that leads the outlines of large bodies to edges of the frame
LEAST_AREA_PX = 4  # of a mask, below which there is no outline to look at


@dataclass(frozen=True)
class Square:
    """A square of a picture, which may reach beyond its border. left, top, side: px."""

    left: int
    top: int
    side: int

    def part(self, picture: np.ndarray) -> np.ndarray:
        """(side, side, ...) of a picture (H, W, ...); beyond the border its last pixels go on."""
        height, width = picture.shape[:2]
        rows = np.clip(np.arange(self.top, self.top + self.side), 0, height - 1)
        columns = np.clip(np.arange(self.left, self.left + self.side), 0, width - 1)
        return np.asarray(picture[rows[:, None], columns[None]])

    def scaled(self, part: np.ndarray) -> np.ndarray:
        """(SIDE, SIDE, ...) of a part (side, side, ...)."""
        part = part.astype(np.float32) if part.dtype == np.bool_ else part
        how = cv2.INTER_AREA if self.side > SIDE else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(part, (SIDE, SIDE), interpolation=how))

    def cut(self, picture: np.ndarray) -> np.ndarray:
        """(SIDE, SIDE, ...) of a picture (H, W, ...)."""
        return self.scaled(self.part(picture))

    def paste(self, values: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, tuple[slice, slice]]:
        """values (SIDE, SIDE) at a picture's scale: the part inside a picture of shape (H, W), and where that is."""
        large = cv2.resize(values, (self.side, self.side), interpolation=cv2.INTER_LINEAR)
        top, left = max(self.top, 0), max(self.left, 0)
        bottom, right = min(self.top + self.side, shape[0]), min(self.left + self.side, shape[1])
        bottom, right = max(bottom, top), max(right, left)
        window = (slice(top, bottom), slice(left, right))
        return large[top - self.top : bottom - self.top, left - self.left : right - self.left], window


def square_around(mask: np.ndarray) -> Square:
    """The square in which a mask (H, W) bool, not empty, is looked at."""
    return square_of(*cv2.boundingRect(mask.astype(np.uint8)))


def square_of(x: int, y: int, width: int, height: int) -> Square:
    """The square in which a body is looked at that fills a box, px."""
    side = max(round(MARGIN * max(width, height)), max(width, height) + 6, LEAST_SIDE_PX)
    return Square(x + width // 2 - side // 2, y + height // 2 - side // 2, side)


def input_of(frame: Tensor, plate: Tensor, masks: Tensor) -> Tensor:
    """What the network is shown: (B, INPUTS, SIDE, SIDE).

    Args:
        frame: (B, 3, SIDE, SIDE) in [0, 1].
        plate: (B, 3, SIDE, SIDE) in [0, 1], the background.
        masks: (B, 3, SIDE, SIDE): where the background is known, the body as far as it is known, other bodies.
    """
    return torch.cat([frame - 0.5, plate - 0.5, CONTRAST * (frame - plate), masks], 1)


def background(frames: np.ndarray, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The picture (H, W, 3) uint8 behind the bodies of masks (T, H, W), and where it is known: (H, W) bool."""
    middle = np.median(frames[:: max(len(frames) // 15, 1)], axis=0).astype(np.uint8)
    plate, filled = clear_plate(frames, masks > 0, middle)
    return plate, ~filled


def pictures(squares: list[np.ndarray]) -> Tensor:
    """(B, 3, SIDE, SIDE) in [0, 1] of pictures (SIDE, SIDE, 3) uint8."""
    return torch.from_numpy(np.stack(squares)).permute(0, 3, 1, 2).float() / 255


def sharpen(frames: np.ndarray, masks: np.ndarray, network: OutlineNetwork, kept: Collection[int] = ()) -> np.ndarray:
    """Masks with outlines where the network sees them.

    Args:
        frames: (T, H, W, 3) uint8.
        masks: (T, H, W) uint8 ids.
        network: For outlines.
        kept: Ids whose outlines stay as they are.
    """
    plate, known = background(frames, masks)
    places = []
    for t, ids in enumerate(masks):
        for body, box in enumerate(ndimage.find_objects(ids), 1):
            if box is None or body in kept or np.count_nonzero(ids[box] == body) < LEAST_AREA_PX:
                continue
            rows, columns = box
            size = columns.stop - columns.start, rows.stop - rows.start
            places.append((t, body, square_of(columns.start, rows.start, *size)))
    soft = []
    with torch.inference_mode():
        for first in range(0, len(places), BATCH):
            shown, behind, near = [], [], []
            for t, body, square in places[first : first + BATCH]:
                ids = square.part(masks[t])
                shown.append(square.cut(frames[t]))
                behind.append(square.cut(plate))
                near.append([square.cut(known), *(square.scaled(m) for m in (ids == body, (ids > 0) & (ids != body)))])
            squares = input_of(pictures(shown), pictures(behind), torch.from_numpy(np.array(near)))
            soft.extend(network(squares).sigmoid().numpy())
    out = np.where(np.isin(masks, list(kept)), masks, 0).astype(masks.dtype)
    best = np.where(out > 0, 1.0, LEVEL).astype(np.float32)
    for (t, body, square), values in zip(places, soft, strict=True):
        large, window = square.paste(values, masks.shape[1:])
        if square.side > SIDE:  # the network saw it smaller than it is
            guide = frames[t][window].astype(np.float32) / 255
            large = guided_filter(guide, large, round(GUIDE_REACH * square.side / SIDE), SMOOTHNESS)
        better = large > best[t][window]
        out[t][window][better] = body
        best[t][window][better] = large[better]
    return out
