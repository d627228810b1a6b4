"""Which shapes: every instance is tried as each of the basic ones, all instances at once.

Where objects do not hide or hit each other their shapes are separate questions, so three short descents, of spheres
alone, of cylinders alone, of boxes alone, answer them for any number of objects.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import BASIC_SHAPES, Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit import HORIZONS, Island
from pipeline.search.found import Record
from pipeline.search.guess import guess_scene

SIMPLER = {"sphere": 0.6, "cylinder": 0.9, "box": 1.0}  # times its cost: of alike fits the one with fewer numbers
assert SIMPLER.keys() == set(BASIC_SHAPES)


def compose(evaluator: Evaluator, record: Record, simulations: int, rng: np.random.Generator) -> Scene:
    """The classical guess with the shape that fits the first frames best for each instance of the target."""
    target, schedule = evaluator.target, evaluator.schedule
    times = schedule.pairs[:, 0] / schedule.fps
    cameras, costs = [], []
    for shape in BASIC_SHAPES:
        start = guess_scene(target, [shape] * target.instances, times)
        island = Island(evaluator, record, simulations, rng, start, np.stack([np.arange(target.instances)] * 2, 1))
        near = island.vary(start, list(range(target.instances)), HORIZONS[0])
        near = island.approach(near, HORIZONS, camera=True)
        residuals, _ = evaluator.residuals(stack_scenes([near]), island.pairs, HORIZONS[-1])
        cameras.append(near)
        costs.append(SIMPLER[shape] * residuals.cost[0])
    best = np.argmin(costs, axis=0)
    leading = cameras[int(np.argmin([c.sum() for c in costs]))]
    assert leading.camera is not None
    shapes = [BASIC_SHAPES[k] for k in best]
    return replace(guess_scene(target, shapes, times, leading.camera), gravity=leading.gravity)
