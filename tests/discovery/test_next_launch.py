"""The recording that is proposed next."""

import numpy as np
import pytest

from pipeline.discovery.discover import discover
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.next_launch import explanations, information
from pipeline.discovery.report.report_dict import verdict_dict
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.world import make_world
from pipeline.physics.simulate import simulate

DRAG = Recipe(71012, ("air_drag",), strength=10.0, clips=2)


def test_a_recording_tells_nothing_where_predictions_agree_and_all_where_they_differ_much() -> None:
    weights = np.array([0.5, 0.5])
    assert information(weights, np.zeros((2, 2))) == pytest.approx(0.0)
    assert information(weights, np.array([[0.0, 1e4], [1e4, 0.0]])) == pytest.approx(1.0)
    assert 0.0 < information(weights, np.array([[0.0, 2.0], [2.0, 0.0]])) < 0.5


def drag() -> Discovery:
    world = make_world(DRAG, np.random.default_rng(DRAG.seed))
    names = ["air_drag", "linear_drag", "wind", "gravity_error"]
    return discover(world.tracks, known_scene(world.known), 0.3, names, np.random.default_rng(0))


def test_two_throws_with_drag_lead_to_a_launch_that_can_be_simulated() -> None:
    found = drag()
    launch = found.verdict.launch
    assert launch is not None
    assert launch.apart > 3 * found.problem.sigma
    assert launch.information > 0.1
    assert launch.sentence in found.verdict.experiment
    assert len(simulate(launch.scene, launch.seconds).position) > 100
    told = verdict_dict(found.verdict)["launch"]
    assert told["velocity"] == list(launch.body.velocity)
    models, weights = explanations(found.selection, found.verdict.confidence)
    assert models[0].effects == found.verdict.effects
    assert weights.sum() == pytest.approx(1.0)


def test_further_recordings_of_a_hidden_world_leave_the_first_ones_as_they_are() -> None:
    first, more = (make_world(DRAG, np.random.default_rng(1), m) for m in ([], [[{"velocity": (0.0, 0.0, 1.0)}]]))
    assert len(more.tracks) == len(first.tracks) + 1
    for one, other in zip(first.tracks, more.tracks, strict=False):
        assert np.array_equal(one.position, other.position)
