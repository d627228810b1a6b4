from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import SCHEDULE
from targets import HEIGHT, WIDTH, evaluator, exact_target, sampled

from pipeline.clips.overlap import assign, count, pair_iou, sequence_iou
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.physics.batch import stack_scenes
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene, SceneObject
from pipeline.search.best_of_k import rank
from pipeline.search.evaluator import INVALID_REWARD, Evaluator
from pipeline.search.target import make_target, resize_flow


def shifted(scene: Scene, metres: float) -> Scene:
    objects = tuple(replace(o, position=(o.position[0] + metres, *o.position[1:])) for o in scene.objects)
    return replace(scene, objects=objects)


@pytest.mark.parametrize("objects", [1, 3])
def test_the_truth_has_the_best_reward_there_is(rng: np.random.Generator, objects: int) -> None:
    scene = sampled(rng, objects)
    rewards = evaluator(scene).rewards(stack_scenes([scene, shifted(scene, 0.05)]))
    assert rewards.iou[0] == 1
    assert rewards.epe[0] == pytest.approx(0, abs=1e-9)
    assert rewards.reward[0] == pytest.approx(1, abs=1e-9)
    assert rewards.reward[1] < 0.99
    assert rewards.valid.all()


def test_the_reward_is_iou_less_the_end_point_error_of_480x320(rng: np.random.Generator) -> None:
    scene, other = sampled(rng, 2), sampled(rng, 2)
    target = exact_target(scene)
    rewards = Evaluator(target, SCHEDULE, 1).rewards(stack_scenes([other]))
    view = pair_view(other, *trace_pairs(simulate(other), SCHEDULE), WIDTH, HEIGHT)
    counts = count(view.mask, target.masks, 2, 2)
    iou = sequence_iou(counts, assign(pair_iou(counts)))
    error = np.linalg.norm(view.flow - target.flow, axis=-1) * 480 / WIDTH
    front = (view.mask > 0) | (target.masks > 0)
    # the batch and the single run part where bodies hit each other
    assert rewards.iou[0] == pytest.approx(iou, abs=0.1)
    assert rewards.epe_frame[0] == pytest.approx(error.mean(), rel=0.2, abs=0.02)
    assert rewards.epe[0] == pytest.approx(error[front].mean(), rel=0.2, abs=0.1)
    assert rewards.reward[0] == rewards.iou[0] - rewards.epe_frame[0]


def test_the_reward_does_not_depend_on_the_order_of_the_objects(rng: np.random.Generator) -> None:
    ball = SceneObject("sphere", (0.2,), 1.0, position=(-0.4, 0, 0.2), velocity=(-0.3, 0, 0))
    brick = SceneObject("sphere", (0.15,), 1.0, position=(0.4, 0.3, 0.15), velocity=(0.5, 0, 0))
    scene = replace(sampled(rng, 1), objects=(ball, brick))
    turned = replace(scene, objects=(brick, ball))
    rewards = evaluator(scene).rewards(stack_scenes([scene, turned]))
    assert rewards.reward[1] == pytest.approx(1, abs=1e-6)


def test_a_fixed_assignment_is_kept(rng: np.random.Generator) -> None:
    scene = sampled(rng, 2)
    e = evaluator(scene)
    right = e.rewards(stack_scenes([scene]), np.array([[0, 0], [1, 1]]))
    wrong = e.rewards(stack_scenes([scene]), np.array([[0, 1], [1, 0]]))
    assert right.iou[0] == 1
    assert wrong.iou[0] < 0.9


def test_an_unstable_candidate_has_the_worst_reward(rng: np.random.Generator) -> None:
    scene = sampled(rng, 1)
    bad = replace(scene, objects=tuple(replace(o, velocity=(1e12, 0, 0)) for o in scene.objects))
    e = evaluator(scene)
    rewards = e.rewards(stack_scenes([scene, bad, scene]))
    assert rewards.valid.tolist() == [True, False, True]
    np.testing.assert_allclose(rewards.reward, [1, INVALID_REWARD, 1])
    assert (e.simulations, e.invalid) == (3, 1)


def test_more_candidates_at_once_have_the_same_rewards(rng: np.random.Generator) -> None:
    scene = sampled(rng, 2)
    e = evaluator(scene)
    candidates = [shifted(scene, x) for x in np.linspace(-0.2, 0.2, 7)]
    together = e.rewards(stack_scenes(candidates)).reward
    alone = [e.rewards(stack_scenes([c])).reward[0] for c in candidates]
    np.testing.assert_allclose(together, alone, atol=1e-9)


def test_rank_sorts_candidates_of_any_composition(rng: np.random.Generator) -> None:
    scene = sampled(rng, 2)
    bad = replace(scene, objects=tuple(replace(o, velocity=(1e12, 0, 0)) for o in scene.objects))
    candidates = [shifted(scene, 0.2), bad, sampled(rng, 1), scene, sampled(rng, 3), scene]
    ranking = rank(evaluator(scene), candidates)
    assert sorted(ranking.order.tolist()) == list(range(6))
    assert ranking.order[:2].tolist() == [3, 5], "of equals the first comes first"
    assert ranking.order[-1] == 1
    rewards = ranking.rewards.reward[ranking.order]
    assert (np.diff(rewards) <= 0).all()
    assert not ranking.rewards.valid[1]


def test_targets_are_brought_to_the_size_of_the_search(rng: np.random.Generator) -> None:
    masks = rng.integers(0, 3, (2, 80, 120)).astype(np.uint8)
    flow = np.full((2, 40, 60, 2), [3.0, -1.0], np.float32)
    target = make_target(masks, flow, 30, 20)
    assert target.masks.shape == (2, 20, 30)
    assert target.instances == 2
    expected = np.where((target.masks > 0)[..., None], [1.5, -0.5], 0.0)  # what is measured elsewhere is noise
    np.testing.assert_allclose(target.flow, expected, rtol=1e-6)
    same = make_target(masks, np.zeros((2, 80, 120, 2)), 120, 80)
    np.testing.assert_array_equal(same.masks, masks)
    np.testing.assert_allclose(resize_flow(flow, 120, 80), np.broadcast_to([6.0, -2.0], (2, 80, 120, 2)), rtol=1e-6)
