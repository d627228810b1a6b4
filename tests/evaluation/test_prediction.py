"""Prediction of unseen frames, and the two baselines without physics."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import SCHEDULE, draw

from pipeline.clips.replay import replay_poses
from pipeline.evaluation.prediction import carried, moved_on, predict
from pipeline.scene.scene import SceneObject


def squares(places: list[tuple[int, int]]) -> np.ndarray:
    masks = np.zeros((len(places), 40, 60), np.uint8)
    for k, (row, column) in enumerate(places):
        masks[k, row : row + 6, column : column + 6] = 1
    return masks


def test_a_mask_that_moves_evenly_is_foretold_exactly() -> None:
    whole = squares([(10, 5 + 2 * k) for k in range(12)])
    np.testing.assert_array_equal(moved_on(whole[:6], 6, fps=30), whole[6:])


def test_a_mask_that_leaves_is_cut_at_the_border_and_does_not_come_back() -> None:
    out = moved_on(squares([(10, 40 + 4 * k) for k in range(4)]), 4, fps=30)
    assert [(m > 0).sum() for m in out] == [24, 0, 0, 0]


def test_a_mask_is_carried_as_far_as_its_object_moves() -> None:
    masks = squares([(10, 2 * k) for k in range(8)])
    beside = squares([(12, 3 + 2 * k) for k in range(8)])
    only = np.array([[0, 0]])
    np.testing.assert_array_equal(carried(beside, masks[:5], only), masks[5:])
    masks[4] = 0
    np.testing.assert_array_equal(carried(beside, masks[:5], only), beside[5:])


def test_a_ball_that_rolls_on_is_carried_by_its_true_scene(rng: np.random.Generator) -> None:
    scene = draw(int(rng.integers(2**31)), [0], {1: 1.0}).scenes[0]
    ball = SceneObject("sphere", (0.15,), 1.0, position=(-0.2, 0.2, 0.15), velocity=(0.4, 0, 0))
    scene = replace(scene, objects=(ball,))
    said = predict(scene, replay_poses(scene, SCHEDULE).masks, 15, SCHEDULE)
    assert said.carried > 0.85 > said.frozen


def test_one_that_is_gone_before_the_end_moves_on_unseen() -> None:
    masks = squares([(10, 2 * k) for k in range(8)])
    masks[5:] = 0
    np.testing.assert_array_equal(moved_on(masks[:6], 2, fps=30), squares([(10, 12), (10, 14)]))


def test_the_true_scene_foretells_its_own_future_and_better_than_the_baselines(rng: np.random.Generator) -> None:
    scene = draw(int(rng.integers(2**31)), [0], {2: 1.0}).scenes[0]
    scene = replace(scene, objects=tuple(replace(o, velocity=(0.6, 0.0, 0.0)) for o in scene.objects))
    masks = replay_poses(scene, SCHEDULE).masks
    said = predict(scene, masks, 15, SCHEDULE)
    assert said.search == pytest.approx(1) and said.seen == pytest.approx(1)
    assert said.velocity <= 1 and said.frozen < 1
