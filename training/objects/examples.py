"""Examples drawn for the training of the model that reads objects."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view
from pipeline.objects.example import Example, example_of
from pipeline.objects.instances import HEIGHT, WIDTH
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.flow_noise import add_raft_noise
from stages.graph.params import Params
from training.drawn_scenes import drawn_scenes


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


def drawn_example(
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
    view = pair_view(scene, *poses, WIDTH, HEIGHT)
    flow = add_raft_noise(rng, view.flow, view.mask, noise) if noise else view.flow
    return example_of(scene, view.mask, flow, poses, schedule, rng if noise else None)


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
        drawn_example(scene, pose, schedule, clip_rng(seed, suite, index, "measurement"), noise)
        for index, scene, pose in zip(indices, scenes, poses, strict=True)
    ]
    return examples, scenes
