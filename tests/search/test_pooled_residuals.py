"""Pooled pictures: what they add up to, and that they tell where to go."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import SCHEDULE
from targets import evaluator, sampled

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.pooled_residuals import LEVELS, Residuals, pool_frame

PAIR = np.array([[0, 0]])


def random_picture(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.integers(0, 4, (20, 30)).astype(np.uint8), rng.normal(size=(20, 30, 2)).astype(np.float32)


@pytest.mark.parametrize("cell", [1, 3, 5])
def test_pooled_sums_give_area_centroid_and_flow(rng: np.random.Generator, cell: int) -> None:
    mask, flow = random_picture(rng)
    pooled = np.zeros((3, 3, -(-20 // cell) + 1, -(-30 // cell) + 1), np.float32)
    pool_frame(mask, flow, (0, 20, 0, 30), cell, pooled)
    for i in range(3):
        rows, columns = np.nonzero(mask == i + 1)
        assert pooled[i, 0].sum() == pytest.approx(len(rows), rel=1e-5)
        across = pooled[i, 0].sum(0) @ (np.arange(pooled.shape[3]) * cell)
        assert across / len(rows) == pytest.approx((columns + 0.5).mean(), rel=1e-4)
        down = pooled[i, 0].sum(1) @ (np.arange(pooled.shape[2]) * cell)
        assert down / len(rows) == pytest.approx((rows + 0.5).mean(), rel=1e-4)
        np.testing.assert_allclose(pooled[i, 1:].sum((1, 2)), flow[mask == i + 1].sum(0), atol=1e-3)


def moved_by(e: Evaluator, scene: Scene, metres: list[float]) -> Residuals:
    scenes = [
        replace(scene, objects=(replace(o, position=(o.position[0] + m, *o.position[1:])),))
        for m in metres
        for o in scene.objects
    ]
    return e.residuals(stack_scenes(scenes), PAIR)[0]


def test_the_residuals_of_the_truth_are_zero_and_grow_with_the_distance(rng: np.random.Generator) -> None:
    scene = sampled(rng, 1)
    residuals = moved_by(evaluator(scene).without_outlines(), scene, [0.0, 0.05, 0.15, 0.4])
    assert residuals.cost[0, 0] == pytest.approx(0, abs=1e-6)
    assert (np.diff(residuals.cost[:, 0]) > 0).all()
    np.testing.assert_allclose((residuals.values**2).sum((1, 2)), residuals.cost[:, 0], rtol=1e-4)


def test_over_the_first_frames_alone_later_motion_does_not_count(rng: np.random.Generator) -> None:
    scene = sampled(rng, 1)
    e = evaluator(scene).without_outlines()
    lighter = replace(scene, gravity=(0, 0, 1.2 * scene.gravity[2]))
    first, _ = e.residuals(stack_scenes([scene, lighter]), PAIR, 1)
    everything, _ = e.residuals(stack_scenes([scene, lighter]), PAIR)
    assert first.values.shape[2] * SCHEDULE.model_frames == everything.values.shape[2]
    assert first.cost[0, 0] == pytest.approx(0, abs=1e-6)
    assert LEVELS > 1


def test_objects_without_an_instance_have_no_residual(rng: np.random.Generator) -> None:
    scene = sampled(rng, 2)
    residuals, _ = evaluator(scene).residuals(stack_scenes([scene]), np.array([[1, 1]]))
    assert not residuals.values[0, 0].any()
