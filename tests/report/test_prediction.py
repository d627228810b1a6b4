"""Forecasts of unseen frames, and the two baselines without physics."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import SCHEDULE, draw

from pipeline.clips.extrapolation import at_constant_velocity, moved_with_replay
from pipeline.clips.replay import replay_poses
from pipeline.report.prediction import forecast_scores
from pipeline.scene.scene import SceneObject


def squares(places: list[tuple[int, int]]) -> np.ndarray:
    masks = np.zeros((len(places), 40, 60), np.uint8)
    for k, (row, column) in enumerate(places):
        masks[k, row : row + 6, column : column + 6] = 1
    return masks


def test_a_mask_at_constant_velocity_is_forecast_exactly() -> None:
    whole = squares([(10, 5 + 2 * k) for k in range(12)])
    np.testing.assert_array_equal(at_constant_velocity(whole[:6], 6, fps=30), whole[6:])


def test_a_mask_that_leaves_is_cut_at_the_border_and_does_not_come_back() -> None:
    out = at_constant_velocity(squares([(10, 40 + 4 * k) for k in range(4)]), 4, fps=30)
    assert [(m > 0).sum() for m in out] == [24, 0, 0, 0]


def test_a_mask_moves_as_far_as_its_object_in_the_replay() -> None:
    masks = squares([(10, 2 * k) for k in range(8)])
    beside = squares([(12, 3 + 2 * k) for k in range(8)])
    only = np.array([[0, 0]])
    np.testing.assert_array_equal(moved_with_replay(beside, masks[:5], only), masks[5:])
    masks[4] = 0
    np.testing.assert_array_equal(moved_with_replay(beside, masks[:5], only), beside[5:])


def test_the_true_scene_of_a_rolling_ball_moves_its_mask_along(rng: np.random.Generator) -> None:
    scene = draw(int(rng.integers(2**31)), [0], {1: 1.0}).scenes[0]
    ball = SceneObject("sphere", (0.15,), 1.0, position=(-0.2, 0.2, 0.15), velocity=(0.4, 0, 0))
    scene = replace(scene, objects=(ball,))
    found = forecast_scores(scene, replay_poses(scene, SCHEDULE).masks, 15, SCHEDULE)
    assert found.moved_with_replay > 0.85 > found.frozen


def test_a_mask_that_was_hidden_at_the_end_keeps_its_velocity() -> None:
    masks = squares([(10, 2 * k) for k in range(8)])
    masks[5:] = 0
    np.testing.assert_array_equal(at_constant_velocity(masks[:6], 2, fps=30), squares([(10, 12), (10, 14)]))


def test_the_true_scene_forecasts_its_own_clip_exactly(rng: np.random.Generator) -> None:
    scene = draw(int(rng.integers(2**31)), [0], {2: 1.0}).scenes[0]
    scene = replace(scene, objects=tuple(replace(o, velocity=(0.6, 0.0, 0.0)) for o in scene.objects))
    masks = replay_poses(scene, SCHEDULE).masks
    found = forecast_scores(scene, masks, 15, SCHEDULE)
    assert found.search == pytest.approx(1) and found.seen == pytest.approx(1)
