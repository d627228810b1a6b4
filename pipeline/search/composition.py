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
from pipeline.search.fit_scene import HORIZONS, Island
from pipeline.search.guess import CAMERA, guess_scene
from pipeline.search.search_result import Record

ROUNDS = {"sphere": 1, "cylinder": 3, "box": 3}  # of variations: the more ways to turn, the more
DOUBT = 3.0  # times the cost of the best shape, up to which the next best may be the right one
assert ROUNDS.keys() == set(BASIC_SHAPES)


def compose(
    evaluator: Evaluator, record: Record, simulations: int, rng: np.random.Generator, camera: Camera = CAMERA,
    most: int = 1,
) -> list[Scene]:  # fmt: skip
    """Scenes with the shapes that fit best for the instances of the target, seen at first by that camera: the best of
    each, and up to `most` in all with the next best of one of them, where that is in doubt.

    Their camera, and the objects of that shape, are those of the one descent of the three that fits best; the others
    are as the classical guess has them.
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
    leader = int(np.argmin(np.sum(costs, axis=1)))
    leading = tried[leader]
    assert leading.camera is not None
    scenes = []
    for kinds in likely(np.array(costs))[:most]:
        guess = guess_scene(target, [BASIC_SHAPES[k] for k in kinds], times, leading.camera)
        objects = (leading.objects[i] if k == leader else guess.objects[i] for i, k in enumerate(kinds))
        scenes.append(replace(leading, objects=tuple(replace(o, name="") for o in objects)))
    return scenes


def likely(costs: np.ndarray) -> list[np.ndarray]:
    """Which kind each instance is, by costs (kinds, N): the best for all, then the next best for one, least lost first,
    where it costs less than DOUBT times the best."""
    order = np.argsort(costs, axis=0, kind="stable")
    best, second = np.take_along_axis(costs, order[:2], 0)
    out = [order[0]]
    for i in np.argsort(second - best, kind="stable"):
        if second[i] < DOUBT * best[i]:
            kinds = order[0].copy()
            kinds[i] = order[1, i]
            out.append(kinds)
    return out
