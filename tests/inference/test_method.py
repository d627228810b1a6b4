"""When a search for scenes may stop."""

import numpy as np
import pytest

from pipeline.inference.method import EXPLAINS_IOU, SEARCH, TRACKS, Method, settled
from pipeline.metrics.overlap import Overlap
from pipeline.scene.scene import Scene


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
