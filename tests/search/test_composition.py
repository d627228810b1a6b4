"""Shapes by evidence: solids registered to outlines, their probabilities, and the scenes that are made of them."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import SCHEDULE
from targets import evaluator, exact_target, sampled

from pipeline.clips.replay import replay_poses
from pipeline.physics.batch import stack_scenes
from pipeline.physics.overlap import penetration
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import BASIC_SHAPES, Scene, SceneObject
from pipeline.search.composition import best_mixture, propose_compositions
from pipeline.search.evaluator import Evaluator
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.outlines.contour import instance_contour
from pipeline.search.outlines.registration import Registration
from pipeline.search.outlines.rigid_flow import replace_flow
from pipeline.search.outlines.shape_evidence import ShapeEvidence, joint_probabilities, probabilities
from pipeline.search.outlines.silhouette import DIRECTIONS, NORMALS, fill_distances, fill_support
from pipeline.search.search_result import DEEPEST, parted
from pipeline.vision.rendering.camera import focal_px, pinhole, project
from pipeline.vision.rendering.surface import BOX, CYLINDER, SPHERE

BODIES = {
    "sphere": SceneObject("sphere", (0.16,), 1.0, position=(0, 0.2, 0.16), velocity=(0.4, 0, 0)),
    "cylinder": SceneObject("cylinder", (0.12, 0.34), 1.0, position=(0, 0.2, 0.17), velocity=(0.4, 0, 0)),
    "box": SceneObject("box", (0.34, 0.2, 0.25), 1.0, position=(0, 0.2, 0.125), angular_velocity=(0, 0, 3)),
}


def clip(shape: str) -> tuple[Scene, ClipOutlines]:
    """One body before a camera, and its outlines at 480x320."""
    scene = replace(sampled(np.random.default_rng(0), 1), objects=(BODIES[shape],))
    masks = replay_poses(scene, SCHEDULE).masks
    return scene, ClipOutlines(masks, np.arange(len(masks)) / SCHEDULE.fps, 1)


@pytest.mark.parametrize("kind", [SPHERE, CYLINDER, BOX])
def test_a_silhouette_bounds_the_projection_of_the_solid_and_touches_it(rng: np.random.Generator, kind: int) -> None:
    half = rng.uniform(0.1, 0.2, 3)
    half[1] = half[0]
    q = rng.normal(size=4)
    rotation, centre = matrix_from_quaternion(q / np.linalg.norm(q)), np.array([0.3, -0.2, -1.5])
    points = rng.normal(size=(200_000, 3))
    if kind == SPHERE:
        points *= half[0] / np.linalg.norm(points, axis=1, keepdims=True)
    elif kind == CYLINDER:
        points[:, :2] *= half[0] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        points[:, 2] = half[2] * np.sign(points[:, 2])
    else:
        points = half * np.sign(points)
    world = points @ rotation.T + centre
    seen = (world[:, :2] / -world[:, 2:]) @ NORMALS.T
    support = np.empty(DIRECTIONS)
    assert fill_support(kind, half, rotation, centre, support)
    np.testing.assert_allclose(support, seen.max(0), atol=1e-3)
    assert (support >= seen.max(0) - 1e-9).all()


def test_distances_to_a_silhouette_are_signed() -> None:
    support, distance, nearest = np.empty(DIRECTIONS), np.empty(2), np.empty(2, np.int64)
    fill_support(SPHERE, np.full(3, 0.1), np.eye(3), np.array([0, 0, -10.0]), support)
    fill_distances(np.array([[3.0, 0.0], [0.0, 0.5]]), 2, 100.0, support, distance, nearest)
    np.testing.assert_allclose(distance, [2.0, -0.5], atol=0.01)


def test_an_outline_beside_another_instance_or_the_border_is_not_the_bodys_own() -> None:
    masks = np.zeros((1, 20, 30), np.uint8)
    masks[0, 5:12, 0:8], masks[0, 5:12, 8:15] = 1, 2
    contour = instance_contour(masks, 0)
    points, free = contour.points[0, : contour.count[0]], contour.free[0, : contour.count[0]]
    at_side = (points[:, 0] == -15) | (points[:, 0] == -7)
    np.testing.assert_array_equal(free, ~at_side)
    assert points[:, 1].max() == 5
    assert points[:, 1].min() == -2
    assert not len(instance_contour(masks, 2).frames)


@pytest.mark.parametrize("shape", list(BODIES))
def test_the_shape_of_a_body_follows_from_its_outlines(shape: str) -> None:
    scene, outlines = clip(shape)
    (evidence,) = outlines.evidence
    assert evidence.ranked[0] == shape
    assert evidence.probability[shape] > 0.9
    assert sum(evidence.probability.values()) == pytest.approx(1)
    fit, camera = evidence.registrations[shape], scene.camera
    assert camera is not None
    assert fit.focal == pytest.approx(focal_px(camera.fov, outlines.height), rel=0.3)
    assert len(fit.frames) == SCHEDULE.frames
    place = replay_poses(scene, SCHEDULE).position[fit.frames, 0]
    wanted, _ = project(place, pinhole(camera), 480, 320)
    got = fit.poses[:, :2] * (1, -1) + (240, 160)
    np.testing.assert_allclose(got, wanted, atol=3.0)


def test_proposed_scenes_have_the_size_and_place_of_the_body_up_to_scale() -> None:
    scene, outlines = clip("box")
    target = exact_target(scene, 120, 80)
    e = Evaluator(target, SCHEDULE, 1, outlines)
    (scenes,) = propose_compositions(outlines, target, e.times, 1).starts
    found = best_mixture(e, scenes)
    assert found.shapes == ("box",)
    assert found.camera is not None
    assert scene.camera is not None
    assert found.camera.pitch == pytest.approx(scene.camera.pitch, abs=5)
    scale = scene.camera.position[2] / found.camera.position[2]
    assert sorted(scale * np.array(found.objects[0].size)) == pytest.approx(sorted(BODIES["box"].size), rel=0.25)
    assert e.rewards(stack_scenes([found])).iou[0] > 0.6


def test_shapes_that_fit_equally_well_are_told_apart_by_their_parameters() -> None:
    first, second, third = probabilities(np.array([100.0, 100.0, 400.0]), 400, np.array([1, 6, 9]))
    assert first > 0.9
    assert first > second > third
    assert probabilities(np.array([np.inf, 1e3, 1e3]), 400, np.array([1, 6, 6]))[0] < 1e-6


def test_joint_probabilities_are_products_best_first() -> None:
    evidence = [
        ShapeEvidence({}, {"sphere": 0.6, "box": 0.4}),
        ShapeEvidence({}, {"sphere": 0.9, "box": 0.1}),
    ]
    found = joint_probabilities(evidence, 3)
    assert [shapes for shapes, _ in found] == [("sphere", "sphere"), ("box", "sphere"), ("sphere", "box")]
    np.testing.assert_allclose([p for _, p in found], [0.54, 0.36, 0.06])


def test_the_flow_of_a_registered_body_is_that_of_its_motion() -> None:
    count = 3
    found = Registration(
        shape="sphere",
        extents=np.array([0.2]),
        focal=100.0,
        frames=np.arange(count),
        times=np.arange(count) / 30,
        poses=np.array([[2.0 * k, 0.0, np.log(2.0)] for k in range(count)]),
        rotations=np.repeat(np.eye(3)[None], count, 0),
        cost=0.0,
        points=1,
        turns=np.repeat(np.eye(3)[None], count - 1, 0),
        turns_seen=np.array([True, False]),
    )
    flow, own = np.zeros((2, 40, 60, 2)), np.zeros((2, 40, 60), bool)
    own[:, 15:25, 25:35] = True
    out = replace_flow(flow, own, found, np.array([[0, 1], [1, 2]]), 60)
    nearest = 2.0 / (2.0 - 0.2)  # depth of the centre over that of the nearest point, which moves by as much more
    np.testing.assert_allclose(out[0, 20, 30], [2.0 * nearest, 0.0], atol=0.02)
    assert not out[0][~own[0]].any()
    assert not out[1].any(), "its rotation is not known there"


def test_objects_that_cannot_be_moved_aside_are_lifted() -> None:
    scene = sampled(np.random.default_rng(0), 1)
    same = tuple(replace(BODIES["sphere"], name=f"ball_{k}") for k in range(3))
    found = parted(replace(scene, objects=same))
    assert penetration(found) <= DEEPEST


def test_outlines_tell_the_truth_from_a_small_shift() -> None:
    scene = replace(sampled(np.random.default_rng(0), 1), objects=(BODIES["box"],))
    e = evaluator(scene)
    shifted = replace(scene, objects=(replace(BODIES["box"], position=(0.01, 0.2, 0.125)),))
    residuals, _ = e.residuals(stack_scenes([scene, shifted]), np.array([[0, 0]]))
    pooled, _ = e.without_outlines().residuals(stack_scenes([scene, shifted]), np.array([[0, 0]]))
    assert pooled.cost[0, 0] < residuals.cost[0, 0] < residuals.cost[1, 0]


def test_the_prior_decides_where_outlines_do_not() -> None:
    """A cylinder that is seen end on has the outline of a sphere."""
    rows, cols = np.mgrid[:160, :240]
    masks = np.repeat((np.hypot(cols - 120, rows - 80) < 20).astype(np.uint8)[None], 6, 0)
    times = np.arange(6) / SCHEDULE.fps
    (plain,) = ClipOutlines(masks, times, 1).evidence
    (told,) = ClipOutlines(masks, times, 1, shape_prior=np.array([[0.001, 0.998, 0.001]])).evidence
    assert plain.ranked[0] == "sphere"
    assert told.probability[BASIC_SHAPES[1]] > plain.probability[BASIC_SHAPES[1]]
    np.testing.assert_allclose(sum(told.probability.values()), 1)
    (unseen,) = ClipOutlines(np.zeros_like(masks), times, 1, shape_prior=np.array([[0.2, 0.3, 0.5]])).evidence
    assert unseen.ranked[0] == BASIC_SHAPES[2]
