"""Examples for the model that reads objects: what is seen of a clip, and what its scene says of each instance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.objects.fields import NOTHING, OBJECT_FIELDS, object_numbers, scene_numbers
from pipeline.objects.instances import Instances, instances_of
from pipeline.objects.mask_errors import with_errors
from pipeline.scene.rotation import quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import BASIC_SHAPES, Scene

MOTION = 9  # position (m), velocity (m/s) and spin (rad/s) of a body in a frame


@dataclass(frozen=True)
class Example:
    """A clip.

    Attributes:
        instances: What the model sees, N of them.
        scene: (4,) numbers of the scene.
        shapes: (N,) int8 index of the basic shape, NOTHING for an instance that is no body.
        values: (N, 19) numbers of the bodies.
        motion: (N, T, 9) position, velocity and spin in each frame.
    """

    instances: Instances
    scene: np.ndarray
    shapes: np.ndarray
    values: np.ndarray
    motion: np.ndarray


def example_of(
    scene: Scene,
    masks: np.ndarray,
    flow: np.ndarray,
    poses: tuple[np.ndarray, np.ndarray],
    schedule: Schedule,
    rng: np.random.Generator | None,
) -> Example:
    """A clip.

    Args:
        scene: In canonical form.
        masks: (P, H, W) uint8, the true ones of the first frames of the model's pairs, i + 1 object i.
        flow: (P, H, W, 2), px per frame interval.
        poses: (P, 2, N, 3) and (P, 2, N, 4) of the bodies in both frames of each pair.
        schedule: Which moments are frames.
        rng: Of the errors of the masks; None: they have none.
    """
    count = len(scene.objects)
    instances = instances_of(masks if rng is None else with_errors(masks, count, rng), flow)
    at = instances.ids - 1
    real = at < count
    shapes = np.full(len(at), NOTHING, np.int8)
    values = np.zeros((len(at), len(OBJECT_FIELDS)), np.float32)
    motion = np.zeros((len(at), len(flow), MOTION), np.float32)
    shapes[real] = [BASIC_SHAPES.index(scene.objects[i].shape) for i in at[real]]
    values[real] = np.array([object_numbers(scene.objects[i]) for i in at[real]]).reshape(-1, len(OBJECT_FIELDS))
    motion[real] = motions(*poses, schedule)[at[real]]
    return Example(instances, scene_numbers(scene), shapes, values, motion)


def motions(position: np.ndarray, quaternion: np.ndarray, schedule: Schedule) -> np.ndarray:
    """(N, T, 9) position, velocity and spin of the bodies between the two frames of each pair."""
    interval = 1 / schedule.fps
    turned = quaternion_multiply(quaternion[:, 1], quaternion_conjugate(quaternion[:, 0]))
    turned = turned * np.where(turned[..., :1] < 0, -1, 1)
    sine = np.linalg.norm(turned[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, turned[..., :1])
    spin = turned[..., 1:] / np.maximum(sine, 1e-9) * angle / interval
    velocity = (position[:, 1] - position[:, 0]) / interval
    return np.concatenate([position[:, 0], velocity, spin], -1).transpose(1, 0, 2).astype(np.float32)
