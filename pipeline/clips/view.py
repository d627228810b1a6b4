"""What the scene's camera sees of a simulated clip: masks, areas, depth and exact flow at chosen frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.compiled import kernel
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.camera import REFERENCE_SIZE, pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import Rendering, rasterise

WIDTH, HEIGHT = REFERENCE_SIZE  # of replays; areas are stated in px of this size, whatever a picture has
#: px, width and height, of the masks from which events take what is in view: in the graph, in training, everywhere.
EVENT_SIZE = (240, 160)


@dataclass(frozen=True)
class View:
    """What the camera sees of P pairs of frames.

    Attributes:
        mask: (P, H, W) uint8 of the first frame of each pair, 0 background, i + 1 object i.
        depth: (P, H, W) float32, m, of the first frame.
        flow: (P, H, W, 2) float32, px from the first frame to the second.
    """

    mask: np.ndarray
    depth: np.ndarray
    flow: np.ndarray


def rendering_of(scene: Scene, position: np.ndarray, quaternion: np.ndarray, width: int, height: int) -> Rendering:
    """Masks and depth of a scene, as its camera sees it.

    Args:
        scene: With a camera.
        position: (F, N, 3), m, of the objects in every frame.
        quaternion: (F, N, 4), w x y z.
        width: Of the picture, px.
        height: Of the picture, px.
    """
    assert scene.camera is not None
    eye = pinhole(scene.camera)
    return rasterise(scene.objects, position, quaternion, eye, width, height, scene.ground, scene.fixed)


def frame_masks(scene: Scene, trace: Trace, schedule: Schedule, width: int, height: int) -> np.ndarray:
    """(F, H, W) masks of every frame of the clip."""
    steps = schedule.frame_steps
    return rendering_of(scene, trace.position[steps], trace.quaternion[steps], width, height).mask


def areas_px(masks: np.ndarray, objects: int) -> np.ndarray:
    """(F, N) area of each object in masks (F, H, W), px of 480x320."""
    counts = np.zeros((len(masks), objects + 1), np.int64)
    _count(masks.reshape(len(masks), -1), counts)
    return counts[:, 1:] * (WIDTH * HEIGHT / masks[0].size)


@kernel
def _count(masks: np.ndarray, counts: np.ndarray) -> None:
    """Into counts (F, N + 1): the pixels of masks (F, P) with each number up to N."""
    for frame in range(len(masks)):
        for pixel in range(masks.shape[1]):
            if masks[frame, pixel] < counts.shape[1]:
                counts[frame, masks[frame, pixel]] += 1


def event_areas(
    scene: Scene, trace: Trace, schedule: Schedule, aspect: float = EVENT_SIZE[0] / EVENT_SIZE[1]
) -> np.ndarray:
    """(F, N) area of each object in every frame, px of 480x320, by masks of one size (`find_events`).

    Args:
        scene: With a camera.
        trace: Its motion.
        schedule: Which steps are frames.
        aspect: Width over height of the film. The masks have as many pixels as EVENT_SIZE.
    """
    height = math.sqrt(EVENT_SIZE[0] * EVENT_SIZE[1] / aspect)
    return areas_px(frame_masks(scene, trace, schedule, round(aspect * height), round(height)), len(scene.objects))


def pair_view(scene: Scene, position: np.ndarray, quaternion: np.ndarray, width: int, height: int) -> View:
    """Masks and depth of the first frame of P pairs, and the flow to the second.

    Args:
        scene: With a camera.
        position: (P, 2, N, 3), m, of the objects in both frames of each pair.
        quaternion: (P, 2, N, 4), w x y z.
        width: Of the masks, px.
        height: Of the masks, px.
    """
    assert scene.camera is not None
    masks, depths, flows = [], [], []
    for p, q in zip(position, quaternion, strict=True):
        first = rendering_of(scene, p[:1], q[:1], width, height)
        moved = exact_flow(scene.objects, p, q, pinhole(scene.camera), width, height, scene.ground, rendering=first)
        masks.append(first.mask[0])
        depths.append(first.depth[0])
        flows.append(moved[0])
    return View(np.stack(masks), np.stack(depths), np.stack(flows))


def trace_pairs(trace: Trace, schedule: Schedule) -> tuple[np.ndarray, np.ndarray]:
    """Poses (P, 2, N, 3), (P, 2, N, 4) at the frames whose flow the model sees."""
    steps = schedule.frame_steps[schedule.pairs]
    return trace.position[steps], trace.quaternion[steps]
