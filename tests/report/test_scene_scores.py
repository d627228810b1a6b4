"""The metrics of docs/formats.md on replays whose scores are known."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.report.scene_scores import METRICS, Reference, score, true_reference
from pipeline.scene.scene import Camera, Scene, SceneObject

CAMERA = Camera((0.0, -2.0, 0.8), fov=42.0, pitch=-20.0)
BALL = SceneObject("sphere", (0.12,), 0.5, position=(-0.3, 0.2, 0.12), velocity=(-0.4, 0.0, 0.0))
BOX = SceneObject("box", (0.2, 0.25, 0.15), 1.0, position=(0.4, 0.1, 0.075), velocity=(0.0, 0.5, 0.0))
SCENE = Scene((BALL, BOX), CAMERA)
SCHEDULE = Schedule()


def test_the_true_scene_scores_full_marks() -> None:
    got = score(SCENE, true_reference(SCENE, SCHEDULE), SCHEDULE)
    assert {m: got[m] for m, more in METRICS.items() if more} == dict.fromkeys(
        [m for m, b in METRICS.items() if b], 1.0
    )
    assert got["epe"] == got["epe_frame"] == got["epe_first"] == 0
    assert all(v == pytest.approx(0, abs=1e-4) for k, v in got.items() if k.startswith("error."))


def test_the_order_of_the_objects_changes_no_score() -> None:
    swapped = Scene((BOX, BALL), CAMERA)
    assert score(swapped, true_reference(SCENE, SCHEDULE), SCHEDULE)["iou"] == pytest.approx(1.0)


def test_an_object_too_few_halves_the_score_of_two() -> None:
    got = score(Scene((BALL,), CAMERA), true_reference(SCENE, SCHEDULE), SCHEDULE)
    assert got["composition"] == 0
    assert got["iou"] == pytest.approx(0.5, abs=1e-6)
    assert not any(key.startswith("error.") for key in got)


def test_parameter_errors_are_mean_absolute_differences_after_the_assignment() -> None:
    heavier = Scene((BOX, replace(BALL, mass=0.9)), CAMERA, gravity=(0, 0, -9.0))
    got = score(heavier, true_reference(SCENE, SCHEDULE), SCHEDULE)
    assert got["error.mass"] == pytest.approx(0.4 / 2)
    assert got["error.gravity"] == pytest.approx(0.81)
    assert got["error.size"] == got["error.position"] == 0


def test_the_flow_error_of_a_scene_at_rest_is_the_mean_length_of_the_true_flow() -> None:
    truth = true_reference(Scene((BALL,), CAMERA), SCHEDULE)
    still = replace(BALL, velocity=(0.0, 0.0, 0.0), sliding_friction=0.0)
    got = score(Scene((still,), CAMERA), truth, SCHEDULE)
    assert got["epe_frame"] == pytest.approx(float(np.linalg.norm(truth.flow, axis=-1).mean()), rel=0.02)


def test_a_replay_that_goes_bad_scores_as_an_empty_view() -> None:
    bad = Scene((replace(BALL, velocity=(1e30, 0.0, 0.0)), BOX), CAMERA)
    got = score(bad, true_reference(SCENE, SCHEDULE), SCHEDULE)
    assert got["valid"] == got["iou"] == 0


def test_a_real_clip_is_compared_in_the_pairs_that_have_flow() -> None:
    own = replay_poses(SCENE, SCHEDULE)
    pairs = SCHEDULE.pairs[:, 0]
    got = score(SCENE, Reference(own.masks, own.frame_flow[pairs], pairs), SCHEDULE)
    assert got["iou"] == 1 and got["epe"] == 0 and "composition" not in got
