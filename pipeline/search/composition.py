"""The shapes of the objects: each instance is fitted as each of the basic shapes, all instances at once.

As long as objects do not occlude or hit each other, their shapes are independent. So three short descents, with
spheres only, cylinders only and boxes only, decide the shapes of any number of objects.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import BASIC_SHAPES, Camera, Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit_scene import HORIZONS, BasinHopping
from pipeline.search.guess import CAMERA, guess_scene
from pipeline.search.search_result import SearchRecord

ROUNDS = {"sphere": 1, "cylinder": 3, "box": 3}  # of random variations; more for shapes with an orientation
DOUBT = 3.0  # ratio of the costs of the second best and the best shape below which the second may be right
assert ROUNDS.keys() == set(BASIC_SHAPES)


def propose_compositions(
    evaluator: Evaluator,
    record: SearchRecord,
    simulations: int,
    rng: np.random.Generator,
    camera: Camera = CAMERA,
    most: int = 1,
) -> list[Scene]:
    """Scenes with the most likely shapes of the target's instances.

    The first has the best shape of each instance; others have the second best shape of one instance, where that is in
    doubt. The camera, and objects of its shape, are taken from the best of the three descents. Other objects are those
    of the classical guess.

    Args:
        evaluator: Evaluates candidates.
        record: Keeps the best scene by reward.
        simulations: The budget.
        rng: Random generator.
        camera: Initial camera.
        most: Largest number of scenes.
    """
    target, schedule = evaluator.target, evaluator.schedule
    times = schedule.pairs[:, 0] / schedule.fps
    everything = list(range(target.instances))
    pairs = np.stack([np.arange(target.instances)] * 2, 1)
    tried, costs = [], []
    for shape in BASIC_SHAPES:
        near = guess_scene(target, [shape] * target.instances, times, camera)
        run = BasinHopping(evaluator, record, simulations, rng, near, pairs)
        for _ in range(ROUNDS[shape]):
            near = run.vary(near, everything, HORIZONS[0])
        near = run.match_first_frames(near, (*HORIZONS, None), camera=True)
        residuals, _ = evaluator.residuals(stack_scenes([near]), pairs)
        tried.append(near)
        costs.append(residuals.cost[0])
    leader = int(np.argmin(np.sum(costs, axis=1)))
    leading = tried[leader]
    assert leading.camera is not None
    scenes = []
    for kinds in likely_shapes(np.array(costs))[:most]:
        guess = guess_scene(target, [BASIC_SHAPES[k] for k in kinds], times, leading.camera)
        objects = (leading.objects[i] if k == leader else guess.objects[i] for i, k in enumerate(kinds))
        scenes.append(replace(leading, objects=tuple(replace(o, name="") for o in objects)))
    return scenes


def likely_shapes(costs: np.ndarray) -> list[np.ndarray]:
    """Shapes (N,) of the instances, most likely first, from costs (shapes, N).

    First the best shape of each instance. Then the second best shape of one instance, in order of the increase in
    cost, where it costs less than `DOUBT` times the best.
    """
    order = np.argsort(costs, axis=0, kind="stable")
    best, second = np.take_along_axis(costs, order[:2], 0)
    out = [order[0]]
    for i in np.argsort(second - best, kind="stable"):
        if second[i] < DOUBT * best[i]:
            kinds = order[0].copy()
            kinds[i] = order[1, i]
            out.append(kinds)
    return out
