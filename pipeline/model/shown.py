"""What the words model is shown of a clip: its bodies one by one, or whole frames; by flow or by colours."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.compiled import kernel
from pipeline.errors import ModelError
from pipeline.model.instances import (
    FULL,
    HEIGHT,
    SIDE,
    WIDTH,
    Instances,
    crop_square,
    instances_of,
    samples_along,
)

FRAME_SIZE = (192, 128)  # px, width and height of a whole frame
FASTEST = 20.0  # px of WIDTH per interval that are FULL in a frame's flow


@dataclass(frozen=True)
class SeenBodies:
    """The bodies of a clip.

    Attributes:
        instances: Their masks, flow and places.
        colours: (N, T, 3, SIDE, SIDE) int8, their crops in colour; None: flow is shown.
    """

    instances: Instances
    colours: np.ndarray | None = None

    @property
    def crops(self) -> np.ndarray:
        """(N, T, C, SIDE, SIDE) int8: colours, or flow right and down; then the body less others."""
        if self.colours is None:
            moving = self.instances.crops[:, :, 2:4]
        else:
            moving = self.colours
        return np.concatenate([moving, own_less_others(self.instances)[:, :, None]], 2)


@dataclass(frozen=True)
class SeenFrames:
    """The frames of a clip: (T, C, h, w) int8, colours, or flow right and down."""

    frames: np.ndarray

    @property
    def colours(self) -> bool:
        """Whether colours are shown."""
        return self.frames.shape[1] == 3


def seen_bodies(
    masks: np.ndarray, flow: np.ndarray, frames: np.ndarray | None, shape_prior: np.ndarray | None = None
) -> SeenBodies:
    """The bodies of a clip.

    Args:
        masks: (T, H, W) uint8, of the first frame of each pair that the model sees.
        flow: (T, h, w, 2), px per interval.
        frames: (T, h, w, 3) uint8, where colours are shown; None: flow is.
        shape_prior: (M, 3) probability of each of `BASIC_SHAPES` for ids 1 to M; None: not known.
    """
    instances = instances_of(masks, flow, shape_prior)
    return SeenBodies(instances, None if frames is None else rgb_crops(frames, instances.places))


def seen_clip(
    input: str,
    sees: str,
    masks: np.ndarray,
    flow: np.ndarray,
    frames: np.ndarray | None,
    shape_prior: np.ndarray | None = None,
) -> SeenBodies | SeenFrames:
    """What the words model is shown of a clip, as it is asked.

    Args:
        input: "flow" or "rgb".
        sees: "bodies" or "frame".
        masks: As `seen_bodies` takes them; so flow and shape_prior.
        flow: (T, h, w, 2).
        frames: (T, h, w, 3) uint8; may be None where flow is shown.
        shape_prior: (M, 3) or None.
    """
    if input == "flow":
        return flow_frames(flow) if sees == "frame" else seen_bodies(masks, flow, None, shape_prior)
    assert frames is not None
    return rgb_frames(frames) if sees == "frame" else seen_bodies(masks, flow, frames, shape_prior)


def most_seen(seen: SeenBodies, most: int) -> SeenBodies:
    """At most so many of the bodies, those that are seen in most frames, in their order."""
    instances = seen.instances
    kept = np.sort(np.argsort(-instances.places[..., 0].sum(1), kind="stable")[:most])
    prior = None if instances.shape_prior is None else instances.shape_prior[kept]
    fewer = Instances(instances.crops[kept], instances.places[kept], instances.ids[kept], prior)
    return SeenBodies(fewer, None if seen.colours is None else seen.colours[kept])


def no_bodies() -> ModelError:
    """The error for a clip without any."""
    return ModelError("the model reads bodies one by one, and the masks of this clip have none")


def own_less_others(instances: Instances) -> np.ndarray:
    """(N, T, SIDE, SIDE) int8: share of the body less half that of others; negative outside of the picture."""
    own, others = instances.crops[:, :, 0].astype(np.int16), instances.crops[:, :, 1].astype(np.int16)
    return np.where(others < 0, others, own - others // 2).clip(-FULL, FULL).astype(np.int8)


def rgb_crops(frames: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Crops in colour.

    Args:
        frames: (T, h, w, 3) uint8.
        places: (N, T, 14) of the instances.

    Returns:
        (N, T, 3, SIDE, SIDE) int8: -FULL black, FULL white, 0 outside of the picture.
    """
    if frames.shape[1:3] != (HEIGHT, WIDTH):
        frames = np.stack([cv2.resize(f, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) for f in frames])
    crops = np.zeros((*places.shape[:2], 3, SIDE, SIDE), np.int8)
    _crop(np.ascontiguousarray(frames), places, crops)
    return crops


@kernel
def _crop(frames: np.ndarray, places: np.ndarray, crops: np.ndarray) -> None:
    """Fill crops (N, T, 3, S, S)."""
    _, height, width, _ = frames.shape
    size = crops.shape[-1]
    for i in range(len(places)):
        for t in range(len(frames)):
            v = places[i, t]
            if v[0] == 0:
                continue
            left, top, side = crop_square(v)
            step = side / size
            sub = samples_along(step)
            for r in range(size):
                for c in range(size):
                    inside, red, green, blue = 0, 0.0, 0.0, 0.0
                    for a in range(sub):
                        y = math.floor(top + (r + (a + 0.5) / sub) * step)
                        for b in range(sub):
                            x = math.floor(left + (c + (b + 0.5) / sub) * step)
                            if 0 <= x < width and 0 <= y < height:
                                inside += 1
                                red += frames[t, y, x, 0]
                                green += frames[t, y, x, 1]
                                blue += frames[t, y, x, 2]
                    if inside:
                        crops[i, t, 0, r, c] = int(red / inside * (2 * FULL / 255) - FULL)
                        crops[i, t, 1, r, c] = int(green / inside * (2 * FULL / 255) - FULL)
                        crops[i, t, 2, r, c] = int(blue / inside * (2 * FULL / 255) - FULL)


def flow_frames(flow: np.ndarray) -> SeenFrames:
    """Frames of flow (T, h, w, 2), px of its own size per interval, on a scale that is finer near 0."""
    scale = np.array([WIDTH / flow.shape[2], HEIGHT / flow.shape[1]], np.float32)
    small = np.stack([cv2.resize(f.astype(np.float32), FRAME_SIZE, interpolation=cv2.INTER_AREA) for f in flow])
    share = np.arcsinh(2 * scale * small) / np.arcsinh(2 * FASTEST)
    return SeenFrames(np.rint(FULL * share.clip(-1, 1)).astype(np.int8).transpose(0, 3, 1, 2))


def rgb_frames(frames: np.ndarray) -> SeenFrames:
    """Frames (T, h, w, 3) uint8 in colour."""
    if frames.shape[1:3] != FRAME_SIZE[::-1]:
        frames = np.stack([cv2.resize(f, FRAME_SIZE, interpolation=cv2.INTER_AREA) for f in frames])
    return SeenFrames(np.rint(frames * (2 * FULL / 255) - FULL).astype(np.int8).transpose(0, 3, 1, 2))
