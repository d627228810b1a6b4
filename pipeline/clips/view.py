"""What the scene's camera sees of a simulated clip: masks, depth and exact flow at chosen frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import rasterise


@dataclass(frozen=True)
class View:
    """mask (F, H, W) uint8, 0 background, i + 1 object i; depth (F, H, W) float32 m; flow (P, H, W, 2) float32 px from
    the first frame of each pair to the second."""

    mask: np.ndarray
    depth: np.ndarray
    flow: np.ndarray


def frame_masks(scene: Scene, trace: Trace, schedule: Schedule, width: int, height: int) -> np.ndarray:
    """(F, H, W) masks of every frame of the clip."""
    assert scene.camera is not None
    steps = schedule.frame_steps
    return rasterise(scene.objects, trace.position[steps], trace.quaternion[steps], pinhole(scene.camera), width,
                     height, scene.ground).mask  # fmt: skip


def pair_view(scene: Scene, position: np.ndarray, quaternion: np.ndarray, width: int, height: int) -> View:
    """Masks and depth of the first frame of P pairs, and the flow to the second: poses (P, 2, N, 3), (P, 2, N, 4)."""
    assert scene.camera is not None
    masks, depths, flows = [], [], []
    for p, q in zip(position, quaternion, strict=True):
        first = rasterise(scene.objects, p[:1], q[:1], pinhole(scene.camera), width, height, scene.ground)
        moved = exact_flow(scene.objects, p, q, pinhole(scene.camera), width, height, scene.ground,
                           rendering=first)  # fmt: skip
        masks.append(first.mask[0])
        depths.append(first.depth[0])
        flows.append(moved[0])
    return View(np.stack(masks), np.stack(depths), np.stack(flows))


def trace_pairs(trace: Trace, schedule: Schedule) -> tuple[np.ndarray, np.ndarray]:
    """Poses (P, 2, N, 3), (P, 2, N, 4) at the frames whose flow the model sees."""
    steps = schedule.frame_steps[schedule.pairs]
    return trace.position[steps], trace.quaternion[steps]
