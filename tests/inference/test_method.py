"""When a search for scenes may stop, and which of several is taken."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.clips.overlap import Overlap
from pipeline.inference.filmed_world import World
from pipeline.inference.method import EXPLAINS_IOU, SEARCH, TRACKS, Method, best_of, is_ambiguous, level_view, settled
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.worlds.arcs import Arc
from pipeline.worlds.view import ArcMotion, View


def method(name: str, iou: float, epe_frame: float = 0.1) -> Method:
    return Method(
        name=name,
        scene=Scene(()),
        answer=None,
        reward=iou - epe_frame,
        iou=iou,
        epe_frame=epe_frame,
        overlap=Overlap(iou, iou, iou, np.zeros((0, 2), int)),
        simulations=1,
    )


@pytest.mark.parametrize("name", [TRACKS, SEARCH])
def test_a_scene_that_explains_the_clip_and_is_the_best_ends_the_search(name: str) -> None:
    answer = method("best of K", EXPLAINS_IOU - 0.1)
    assert settled([answer, method(name, EXPLAINS_IOU + 0.01)])
    assert not settled([answer, method(name, EXPLAINS_IOU - 0.01)])


def test_a_scene_that_is_worse_than_the_model_s_answer_does_not_end_the_search() -> None:
    assert not settled([method("best of K", 0.75), method(TRACKS, 0.65)])


def test_a_scene_in_an_ambiguous_view_has_to_be_clearly_better_than_one_on_a_table() -> None:
    tracks = replace(method(TRACKS, 0.9), ambiguous=True)
    assert not settled([tracks])
    assert best_of([tracks, method(SEARCH, 0.88)]).name == SEARCH
    assert best_of([tracks, method(SEARCH, 0.8)]).name == TRACKS


def view(kind: str, slope: float, costs: dict[str, float]) -> View:
    """A view of a straight motion with a slope, deg, and a body at rest."""
    arc = Arc(1, 0, 30, 0.5, 1.0, np.zeros(2), np.zeros(2), np.zeros(2), np.eye(3), 1.0, np.zeros(2))
    motions = (ArcMotion(arc, "straight", 50.0, slope, 1.0), ArcMotion(arc, "rest", 0.0, 80.0, 1.0))
    return View(kind, motions, None, 0.0, 0.0, "", costs=costs)


def test_a_table_that_is_nearly_as_likely_leaves_the_view_open() -> None:
    near, far = {"top": 10.0, "table": 14.0}, {"top": 10.0, "table": 30.0}
    assert is_ambiguous(view("top", 30.0, near), World())
    assert not is_ambiguous(view("top", 30.0, far), World())
    assert not is_ambiguous(view("top", 30.0, near), World(view="top"))
    assert not is_ambiguous(view("top", 30.0, near), World.of(length=(0, 0, 10, 0, 1.0)))


@pytest.mark.parametrize(("down", "kind"), [(0.0, "side"), (30.0, "table"), (88.0, "top")])
def test_the_camera_tells_how_a_level_ground_is_seen(down: float, kind: str) -> None:
    ball = SceneObject("sphere", (0.1,), 1.0)
    assert level_view(Scene((ball,), Camera((0, -1, 1), 40.0, pitch=-down))) == kind
