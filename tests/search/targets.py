"""Targets of searches: what exact masks and flow of a scene are."""

import numpy as np
from sampled_scenes import SCHEDULE, draw

from pipeline.clips.view import pair_view
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.target import Target, make_target

WIDTH, HEIGHT = 60, 40


def exact_target(scene: Scene, width: int = WIDTH, height: int = HEIGHT) -> Target:
    """What a search would find to be perfect: the replay in a batch, as the search replays."""
    steps = SCHEDULE.frame_steps[SCHEDULE.pairs]
    batch = stack_scenes([scene])
    simulator = BatchSimulator(batch.shapes, batch.has_ground, 1, 1, batch.fixed_kinds)
    states = simulator.run(batch, np.unique(steps))
    where = np.searchsorted(np.unique(steps), steps)
    view = pair_view(scene, states.position[0][where], states.quaternion[0][where], width, height)
    return make_target(view.mask, view.flow, width, height)


def sampled(rng: np.random.Generator, objects: int) -> Scene:
    return draw(int(rng.integers(2**31)), [0], {objects: 1.0}).scenes[0]


def evaluator(scene: Scene) -> Evaluator:
    return Evaluator(exact_target(scene), SCHEDULE, threads=1)
