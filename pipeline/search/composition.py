"""Which shapes: every instance is tried as each of the basic ones, all instances at once.

Where objects do not hide or hit each other their shapes are separate questions, so three short descents, of spheres
alone, of cylinders alone, of boxes alone, answer them for any number of objects.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import BASIC_SHAPES, Camera, Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit import HORIZONS, Island
from pipeline.search.found import Record
from pipeline.search.guess import CAMERA, guess_scene

ROUNDS = {"sphere": 1, "cylinder": 3, "box": 3}  # of variations: the more ways to turn, the more
assert ROUNDS.keys() == set(BASIC_SHAPES)


def compose(
    evaluator: Evaluator, record: Record, simulations: int, rng: np.random.Generator, camera: Camera = CAMERA
) -> Scene:
    """A scene with the shape that fits best for each instance of the target, seen at first by that camera.

    Its camera, and the objects of that shape, are those of the one descent of the three that fits best; the others are
    as the classical guess has them.
    """
    target, schedule = evaluator.target, evaluator.schedule
    times = schedule.pairs[:, 0] / schedule.fps
    everything = list(range(target.instances))
    pairs = np.stack([np.arange(target.instances)] * 2, 1)
    tried, costs = [], []
    for shape in BASIC_SHAPES:
        near = guess_scene(target, [shape] * target.instances, times, camera)
        island = Island(evaluator, record, simulations, rng, near, pairs)
        for _ in range(ROUNDS[shape]):
            near = island.vary(near, everything, HORIZONS[0])
        near = island.approach(near, (*HORIZONS, None), camera=True)
        residuals, _ = evaluator.residuals(stack_scenes([near]), pairs)
        tried.append(near)
        costs.append(residuals.cost[0])
    best = np.argmin(costs, axis=0)
    leader = int(np.argmin(np.sum(costs, axis=1)))
    leading = tried[leader]
    assert leading.camera is not None
    guess = guess_scene(target, [BASIC_SHAPES[k] for k in best], times, leading.camera)
    objects = (leading.objects[i] if k == leader else guess.objects[i] for i, k in enumerate(best))
    return replace(leading, objects=tuple(replace(o, name="") for o in objects))
