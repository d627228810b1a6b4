"""A search sees fixed bodies: they carry, stop and hide the objects."""

from dataclasses import replace

import numpy as np
import pytest
import targets

from pipeline.clips.draw_views import draw_view_clips, view_kind
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import rank
from pipeline.search.evaluator import Evaluator
from pipeline.search.parameters import search_space


@pytest.fixture(scope="module")
def clips() -> list[Scene]:
    drawn = draw_view_clips(11, "views", range(15), targets.SCHEDULE).scenes
    return [s for k, s in enumerate(drawn) if s.fixed or view_kind(k) == "side"]


def test_the_true_scene_with_its_fixed_bodies_has_the_best_reward(clips: list[Scene]) -> None:
    assert any(s.fixed for s in clips)
    for scene in clips:
        evaluator = Evaluator(targets.exact_target(scene, 120, 80), targets.SCHEDULE, threads=1)
        moved = replace(scene, fixed=tuple(replace(b, position=tuple(np.add(b.position, 0.05))) for b in scene.fixed))
        ranking = rank(evaluator, [replace(scene, fixed=()), moved, scene])
        assert ranking.rewards.iou[2] == pytest.approx(1.0, abs=1e-9)
        assert ranking.rewards.reward[2] == ranking.rewards.reward.max()


def test_a_search_space_keeps_fixed_bodies_and_hollowness(clips: list[Scene]) -> None:
    for scene in clips:
        space = search_space(scene)
        again = space.scene(space.encode())
        assert again.fixed == scene.fixed
        assert [o.hollow for o in again.objects] == [o.hollow for o in scene.objects]
