"""Examples for the model that reads objects: clips drawn, simulated and rasterised, with the labels of each instance."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view
from pipeline.objects.fields import NOTHING, OBJECT_FIELDS, object_numbers, scene_numbers
from pipeline.objects.instances import HEIGHT, WIDTH, Instances, instances_of
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.scene.rotation import quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import BASIC_SHAPES, Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.flow_noise import add_raft_noise
from stages.graph.params import Params
from training.drawn_scenes import drawn_scenes
from training.objects.mask_errors import with_errors

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


def poses_of(scenes: Sequence[Scene], schedule: Schedule) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses (P, 2, N, 3), (P, 2, N, 4) of each scene at the model's pairs of frames."""
    unique, inverse = np.unique(schedule.frame_steps[schedule.pairs], return_inverse=True)
    inverse = inverse.reshape(schedule.pairs.shape)
    groups: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for k, scene in enumerate(scenes):
        groups[scene.shapes].append(k)
    poses: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for shapes, members in groups.items():
        states = BatchSimulator(shapes, True, len(members), 1).run(stack_scenes([scenes[k] for k in members]), unique)
        for row, k in enumerate(members):
            poses[k] = states.position[row][inverse], states.quaternion[row][inverse]
    return [poses[k] for k in range(len(scenes))]


def example_of(
    scene: Scene, poses: tuple[np.ndarray, np.ndarray], schedule: Schedule, rng: np.random.Generator, noise: float = 1.0
) -> Example:
    """A clip with masks and flow as they are measured.

    Args:
        scene: In canonical form.
        poses: Of `poses_of`.
        schedule: Which moments are frames.
        rng: Of the errors.
        noise: Strength of the errors of the flow; 0: neither masks nor flow have any.
    """
    count = len(scene.objects)
    view = pair_view(scene, *poses, WIDTH, HEIGHT)
    masks, flow = view.mask, view.flow
    if noise:
        flow = add_raft_noise(rng, view.flow, view.mask, noise)
        masks = with_errors(view.mask, count, rng)
    instances = instances_of(masks, flow)
    at = instances.ids - 1
    real = at < count
    shapes = np.full(len(at), NOTHING, np.int8)
    values = np.zeros((len(at), len(OBJECT_FIELDS)), np.float32)
    motion = np.zeros((len(at), len(masks), MOTION), np.float32)
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


def make_examples(
    params: Params,
    seed: int,
    suite: str,
    indices: range,
    objects: Mapping[int, float],
    without: Sequence[str],
    noise: float = 1.0,
) -> tuple[list[Example], list[Scene]]:
    """Examples and their scenes.

    Args:
        params: All parameters of the experiment.
        seed: Instead of the parameters' own.
        suite: Names the random streams of the clips.
        indices: Of the clips.
        objects: Number of objects -> weight.
        without: Compositions that are never drawn.
        noise: Strength of the errors.
    """
    schedule = params.clip.schedule
    scenes = drawn_scenes(params, seed, suite, indices, objects, without)
    poses = poses_of(scenes, schedule)
    examples = [
        example_of(scene, pose, schedule, clip_rng(seed, suite, index, "measurement"), noise)
        for index, scene, pose in zip(indices, scenes, poses, strict=True)
    ]
    return examples, scenes
