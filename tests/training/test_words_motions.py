"""Motions in files, and views of them: what a camera sees, and the scene that is the right answer."""

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pipeline.clips.events import KINDS, Event, physical_events
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.rotation import quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import BASIC_SHAPES
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.words import views
from training.words.examples import ANSWERS, SHARES, example
from training.words.motions import PLACE, SLIDING, Motion, drawn_motions, read_motions, write_motions
from training.words.views import FIRST, HEIGHT, WIDTH, Fields, MotionView, Pictures, draw_view, motion_labels, pictures

PARAMS = read_params_file(PARAMS_FILE, Params)
STEPS = PARAMS.clip.schedule.frame_steps


@pytest.fixture(scope="module")
def alone() -> list[Motion]:
    """Motions of one body each."""
    return drawn_motions(PARAMS, 3, "test of views", range(24), {1: 1.0})


@pytest.fixture(scope="module")
def together() -> list[Motion]:
    """Motions of one to four bodies."""
    return drawn_motions(PARAMS, 3, "test of views", range(24))


def views_of(motions: list[Motion], seed: int = 0) -> list[tuple[Motion, MotionView]]:
    """A view of each motion that has one."""
    rng = np.random.default_rng(seed)
    found = [(motion, draw_view(motion, rng)) for motion in motions]
    kept = [(motion, view) for motion, view in found if view is not None]
    assert len(kept) >= len(motions) / 2
    return kept


def unscaled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only turn, mirror and shift motions."""
    monkeypatch.setattr(views, "SCALES", (1.0, 1.0))


# Files


def a_motion(rng: np.random.Generator, bodies: int, events: list[Event], reach: float = 3.0) -> Motion:
    """A motion of any kind, within `reach` metres."""
    quaternion = rng.standard_normal((30, bodies, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return Motion(
        rng.integers(len(BASIC_SHAPES), size=bodies).astype(np.int8),
        rng.standard_normal((bodies, 20)).astype(np.float32),
        float(np.float32(rng.uniform(2, 12))),
        rng.uniform(-reach, reach, (30, bodies, 3)),
        quaternion,
        events,
    )


def assert_read_back(motions: list[Motion], path: Path) -> None:
    write_motions(motions, path)
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    back = read_motions(path)
    assert len(back) == len(motions)
    for got, true in zip(back, motions, strict=True):
        assert np.array_equal(got.shapes, true.shapes)
        assert np.array_equal(got.values, true.values)
        assert got.gravity == pytest.approx(true.gravity, rel=1e-6)
        assert np.abs(got.position - true.position).max() <= 2e-4
        assert np.abs(got.quaternion - true.quaternion).max() <= 1e-4
        assert got.events == true.events


def test_a_file_of_simulated_motions_is_read_back(tmp_path: Path, together: list[Motion]) -> None:
    assert any(m.events for m in together)
    assert_read_back(together, tmp_path / "00000.npz")


def test_a_file_of_arbitrary_motions_is_read_back(tmp_path: Path, rng: np.random.Generator) -> None:
    every = [Event(k / 240, kind, 0, 1 if kind.startswith("hits_o") else None) for k, kind in enumerate(KINDS)]
    last = [Event(1.0, "hits_object", 0, 2)]
    motions = [a_motion(rng, n, e) for n, e in ((1, []), (2, every), (4, []), (3, last), (1, []))]
    assert_read_back([*motions, a_motion(rng, 2, [], reach=6.5)], tmp_path / "00000.npz")


def test_a_file_without_events_is_read_back(tmp_path: Path, rng: np.random.Generator) -> None:
    assert_read_back([a_motion(rng, 1, []), a_motion(rng, 2, [])], tmp_path / "00000.npz")


def test_a_motion_starts_where_its_values_say(together: list[Motion]) -> None:
    for motion in together:
        assert np.abs(motion.position[0] - motion.values[:, PLACE : PLACE + 3]).max() < 1e-6


# Views


def simulated(view: MotionView) -> Trace:
    return simulate(view.scene, PARAMS.clip.schedule.seconds)


def path_errors(found: list[tuple[Motion, MotionView]]) -> tuple[np.ndarray, np.ndarray]:
    """Of each view the largest distance (mm) and angle (rad) between its poses and those of its scene, simulated."""
    distances, angles = [], []
    for _, view in found:
        trace = simulated(view)
        distances.append(1000 * np.linalg.norm(trace.position[STEPS] - view.position, axis=-1).max())
        by_view, by_scene = since_start(view.quaternion), since_start(trace.quaternion[STEPS])
        angles.append(2 * np.arccos(np.abs(np.sum(by_view * by_scene, -1)).clip(0, 1)).max())
    return np.array(distances), np.array(angles)


def since_start(quaternion: np.ndarray) -> np.ndarray:
    """(F, N, 4) rotations in the world since the first frame, which no symmetry of a body changes."""
    return quaternion_multiply(quaternion, np.broadcast_to(quaternion_conjugate(quaternion[0]), quaternion.shape))


def test_the_scene_of_a_view_moves_as_the_view_does(alone: list[Motion]) -> None:
    distances, angles = path_errors(views_of(alone))  # measured: medians 0.2 mm and 0.01 rad
    assert np.median(distances) < 2
    assert np.median(angles) < 0.05


def test_the_scene_of_an_unscaled_view_moves_exactly_as_the_view_does(
    alone: list[Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    unscaled(monkeypatch)
    distances, angles = path_errors(views_of(alone))
    assert np.median(distances) < 0.05
    assert np.median(angles) < 1e-3


def test_the_scene_of_a_view_with_several_bodies_moves_as_the_view_does(together: list[Motion]) -> None:
    distances, _ = path_errors(views_of(together))  # contacts between bodies do not scale exactly
    assert np.median(distances) < 10


def test_an_unscaled_view_has_the_same_kinds_of_physical_events(
    alone: list[Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    unscaled(monkeypatch)
    same = []
    for motion, view in views_of(alone):
        events = physical_events(simulated(view), view.scene.shapes, views.DEFAULT_THRESHOLDS)
        same.append(Counter(e.kind for e in events) == Counter(e.kind for e in motion.events))
    assert np.mean(same) >= 0.9


def test_the_events_of_a_view_are_those_of_the_motion_that_are_in_view(together: list[Motion]) -> None:
    told = 0
    for motion, view in views_of(together):
        own = [round(float(f), 2) for f in motion.values[:, SLIDING]]  # tells the bodies apart in any order
        if len(set(own)) < len(own):
            continue
        there = {(e.time, e.kind, frozenset(own[i] for i in e.objects)) for e in motion.events}
        times = [e.time for e in view.events]
        assert times == sorted(times)
        for e in view.events:
            if e.kind not in ("enters", "leaves"):
                assert (
                    e.time,
                    e.kind,
                    frozenset(round(view.objects[i].sliding_friction, 2) for i in e.objects),
                ) in there
                assert e.second is None or e.first < e.second
                told += 1
    assert told > 10


def test_masks_are_those_of_the_canonical_scene_in_every_frame(together: list[Motion]) -> None:
    for _, view in views_of(together):
        start = np.array([o.orientation for o in view.objects])
        quaternion = quaternion_multiply(
            since_start(view.quaternion)[FIRST], np.broadcast_to(start, (len(FIRST), *start.shape))
        )
        by_scene = rasterise(view.objects, view.position[FIRST], quaternion, pinhole(view.camera), WIDTH, HEIGHT).mask
        differs = (by_scene != pictures(view).masks).sum((1, 2))
        assert differs.max() <= 3  # px on an edge, by rounding
        assert np.abs(view.position[0] - [o.position for o in view.objects]).max() < 1e-5


def test_flow_is_on_bodies_alone_and_bodies_are_within_their_rectangle(together: list[Motion]) -> None:
    for _, view in views_of(together):
        seen = pictures(view)
        assert not seen.flow[seen.masks == 0].any()
        for mask, (top, bottom, left, right) in zip(seen.masks, seen.within, strict=True):
            assert np.count_nonzero(mask) == np.count_nonzero(mask[top:bottom, left:right])


def test_flow_points_where_the_bodies_go(alone: list[Motion]) -> None:
    checked = 0
    for _, view in views_of(alone):
        seen = pictures(view)
        camera = pinhole(view.camera)
        for t in range(len(FIRST)):
            here, there = (project(view.position[FIRST[t] + k], camera, WIDTH, HEIGHT)[0][0] for k in (0, 1))
            moved = there - here
            if np.count_nonzero(seen.masks[t]) > 200 and np.linalg.norm(moved) > 2:  # px, more than turning takes away
                assert seen.flow[t][seen.masks[t] > 0].mean(0) @ moved > 0
                checked += 1
    assert checked > 20


def test_bodies_in_view_at_first_stand_from_left_to_right(together: list[Motion]) -> None:
    for _, view in views_of(together):
        seen = [i for i in range(len(view.objects)) if 4 * (pictures(view).masks[0] == i + 1).sum() > views.VISIBLE_PX]
        x = project(view.position[0], pinhole(view.camera), WIDTH, HEIGHT)[0][:, 0][seen]
        assert (np.diff(x) > 0).all()


def test_labels_of_motion_are_derivatives_of_the_poses(alone: list[Motion]) -> None:
    for _, view in views_of(alone):
        trace, labels = simulated(view), motion_labels(view)
        assert labels.shape == (1, len(FIRST), 9)
        assert np.abs(labels[0, :, :3] - view.position[FIRST, 0]).max() < 1e-6
        moved = 30 * (view.position[FIRST + 1, 0] - view.position[FIRST, 0])
        assert np.abs(labels[0, :, 3:6] - moved).max() < 1e-5
        body = view.objects[0]
        if trace.contacts.step.size == 0:  # it flies, and spins as it did
            assert labels[0, 0, 3:5] == pytest.approx(body.velocity[:2], abs=1e-3)
            if body.shape == "sphere":
                assert labels[0, :, 6:] == pytest.approx(np.tile(body.angular_velocity, (10, 1)), abs=1e-2)


# Ranges


def test_the_ranges_of_views_are_those_of_the_parameters() -> None:
    d, filters = PARAMS.sample.distribution, PARAMS.sample.filters
    given = {
        "camera_height": views.HEIGHTS,
        "camera_target_height": views.TARGETS,
        "camera_fov": views.FOVS,
        "camera_distance": views.DISTANCE,
        "gravity": views.GRAVITIES,
        "mass": views.MASSES,
        "rolling_friction": views.ROLLINGS,
        "sphere_radius": views.SIZES["sphere"][0],
        "cylinder_radius": views.SIZES["cylinder"][0],
        "cylinder_height": views.SIZES["cylinder"][1],
        "x": views.PLACES[0],
        "y": views.PLACES[1],
    }
    assert given == {key: getattr(d, key) for key in given}
    assert views.SIZES["box"] == (tuple(d.box_side),) * 3
    assert (filters.area_px, filters.visible_px, filters.out_of_view) == (views.AREA_PX, views.VISIBLE_PX, 1)
    assert np.allclose(views.CENTRE, [np.mean(d.x), np.mean(d.y)])


def test_the_frames_of_views_are_those_of_the_schedule() -> None:
    schedule = PARAMS.clip.schedule
    assert np.array_equal(schedule.frame_steps / STEPS_PER_SECOND, views.TIMES)
    assert np.array_equal(schedule.pairs, np.stack([FIRST, FIRST + 1], 1))
    assert schedule.fps == views.FPS


def test_scenes_of_views_stay_in_the_ranges_of_the_parameters(together: list[Motion]) -> None:
    d = PARAMS.sample.distribution
    sizes = {"sphere": [d.sphere_radius], "cylinder": [d.cylinder_radius, d.cylinder_height], "box": [d.box_side] * 3}

    def within(value: float, limits: tuple[float, float], name: str) -> None:
        slack = 1e-6 + 1e-5 * abs(value)
        assert limits[0] - slack <= value <= limits[1] + slack, name

    found = [view for seed in range(3) for _, view in views_of(together, seed)]
    for view in found:
        scene, camera = view.scene, view.camera
        within(-scene.gravity[2], d.gravity, "gravity")
        assert scene.gravity[:2] == (0.0, 0.0)
        within(camera.position[2], d.camera_height, "height")
        within(camera.fov, d.camera_fov, "fov")
        assert camera.pitch is not None
        target = camera.position[2] + d.camera_distance * math.tan(math.radians(camera.pitch))
        within(target, d.camera_target_height, "target")
        for body in view.objects:
            for value, limits in zip(body.size, sizes[body.shape], strict=True):
                within(value, limits, f"size of {body.shape}")
            within(body.mass, d.mass, "mass")
            within(body.sliding_friction, d.sliding_friction, "sliding_friction")
            within(body.rolling_friction, d.rolling_friction, "rolling_friction")
            within(body.damping, d.damping, "damping")
            within(body.position[0], d.x, "x")
            within(body.position[1], d.y, "y")
            assert np.linalg.norm(body.orientation) == pytest.approx(1, abs=1e-4)


def test_one_seed_gives_one_view(together: list[Motion]) -> None:
    for (_, one), (_, other) in zip(views_of(together, 5), views_of(together, 5), strict=True):
        assert one.scene == other.scene
        assert one.events == other.events
        assert np.array_equal(one.position, other.position)


# Examples


@pytest.fixture(scope="module")
def fields() -> Fields:
    return Fields(count=1)


@pytest.mark.parametrize("kind", SHARES)
def test_an_example_shows_its_kind_and_has_answers(kind: str, together: list[Motion], fields: Fields) -> None:
    rng = np.random.default_rng(0)
    for _, view in views_of(together)[:3]:
        found = example(view, kind, fields, rng)
        assert found is not None
        count, arrays = found
        channels = 3 if kind.endswith("rgb") else 2
        if kind.startswith("frame"):
            assert count == 0
            assert arrays["frames"].shape == (len(FIRST), channels, 128, 192)
            assert np.abs(arrays["frames"]).max() > 10
        else:
            assert count == len(arrays["shapes"]) == len(arrays["crops"])
            assert arrays["crops"].shape[1:] == (len(FIRST), channels + 1, 32, 32)
            assert arrays["order"].shape == arrays["numbers"].shape == (ANSWERS, count)
        assert len(arrays["ask"]) == ANSWERS


def test_errors_of_flow_are_smaller_than_the_flow(together: list[Motion], fields: Fields) -> None:
    rng = np.random.default_rng(0)
    share = []
    for _, view in views_of(together):
        seen = pictures(view)
        wrong = views.noisy(seen.flow, seen.masks, seen.within, fields, rng) - seen.flow
        share.append(_mean_length(wrong, seen) / _mean_length(seen.flow, seen))
    assert 0.01 < np.median(share) < 0.5


def _mean_length(flow: np.ndarray, seen: Pictures) -> float:
    return float(np.linalg.norm(flow[seen.masks > 0], axis=-1).mean())
