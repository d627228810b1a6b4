"""How well clips determine their parameters."""

import numpy as np
import pytest
from sampled_scenes import draw

from pipeline.report.determined import HEADER, determined_table, spreads_by_kind, true_value
from pipeline.scene.scene import Scene


@pytest.fixture
def truth(rng: np.random.Generator) -> Scene:
    return draw(int(rng.integers(2**31)), [0], {2: 1.0}).scenes[0]


def test_a_true_value_is_that_of_the_matched_instance(truth: Scene) -> None:
    shapes = truth.shapes[::-1]
    assert true_value(truth, "objects[0].velocity[1]", shapes, [1, 0]) == truth.objects[1].velocity[1]
    assert true_value(truth, "objects[1].mass", shapes, [1, 0]) == truth.objects[0].mass
    assert true_value(truth, "gravity", shapes, [1, 0]) == -truth.gravity[2]
    assert true_value(truth, "objects[0].mass", shapes, [-1, 0]) is None
    assert true_value(truth, "objects[0].size[0]", ("capsule", "capsule"), [0, 1]) is None


def test_truths_within_two_spreads_are_counted_and_factors_are_compared_as_ratios(truth: Scene) -> None:
    mass, damping = truth.objects[0].mass, truth.objects[0].damping
    rows = [
        {"place": "objects[0].mass", "kind": "mass", "value": 3 * mass, "spread": 2.0, "unit": "factor", "share": 0.4},
        {
            "place": "objects[0].damping",
            "kind": "damping",
            "value": damping + 3,
            "spread": 1.0,
            "unit": "-",
            "share": 1,
        },
    ]
    header, cells = determined_table(spreads_by_kind([(rows, truth, [0, 1], truth), (rows[1:], truth, [0, 1], None)]))
    assert header == HEADER
    assert cells == [
        ["mass", "factor", "1", "1.00", "2", "1.00 of 1", "1.6"],
        ["damping", "-", "2", "0.00", "1", "0.00 of 1", "3.0"],
    ]
