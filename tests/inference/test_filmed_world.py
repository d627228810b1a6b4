"""The world of a clip from its tracks, the forecast of unseen frames, and the grade."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import image_tracks
from pipeline.bodies.user_clip import UserClip
from pipeline.clips.replay import replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError
from pipeline.inference.body_tracks import body_tracks, clip_track, objects_of, track_table
from pipeline.inference.filmed_world import FilmedWorld, World, filmed_world, seen_as, with_forecast, with_scene
from pipeline.inference.find_scenes import from_tracks
from pipeline.inference.measured_clip import MeasuredClip
from pipeline.inference.scene_search import clip_evaluator, search_clip
from pipeline.inference.trust import Forecast, fitted_frames, grade, gravity_doubt
from pipeline.scene.scene import Scene, SceneObject
from pipeline.vision.recordings.letterbox import Letterbox, letterbox_for
from pipeline.vision.recordings.video import Clip
from pipeline.worlds.plane import Plane

SCHEDULE = Schedule()
TIMES = np.arange(SCHEDULE.frames) / SCHEDULE.fps
THROW = Scene(
    (SceneObject("sphere", (0.08,), 1.0, position=(-0.8, 0, -0.2), velocity=(1.6, 0, 3.0)),),
    Plane(480, 320, 200.0).camera(),
    ground=None,
)


def clip_of(scene: Scene) -> UserClip:
    """A scene's clip with its own masks."""
    shown = replay_poses(scene, SCHEDULE)
    letterbox = letterbox_for((480, 320), (480, 320))
    clip = Clip(
        frames=shown.pictures("raycast"),
        times=TIMES,
        source_times=TIMES,
        source_size=(480, 320),
        source_fps=30.0,
        letterbox=letterbox,
    )
    return UserClip(clip, shown.masks, "masks.npz", None, ())


@pytest.fixture(scope="module")
def throw() -> UserClip:
    return clip_of(THROW)


def fitted(clip: UserClip, world: World) -> FilmedWorld:
    found = with_scene(filmed_world(clip, world))
    return with_forecast(found) if found.answer is not None else found


def test_a_throw_is_answered_and_forecast(throw: UserClip) -> None:
    found = fitted(throw, World())
    assert found.motion.view.kind == "flight"
    assert found.answer is not None
    assert found.forecast is not None
    assert found.forecast.iou > 0.8 > found.forecast.constant_velocity_iou
    assert grade(0.9, found.forecast).name == "good"


def test_a_view_that_the_tracks_contradict_is_refused(throw: UserClip) -> None:
    with pytest.raises(ParamsError, match="incline"):
        filmed_world(throw, World(view="incline"))


def test_a_view_that_is_given_is_kept(throw: UserClip) -> None:
    found = fitted(throw, World(view="table"))
    assert found.motion.view.kind == "table"
    assert found.answer is not None
    assert found.answer.scene.ground == 0


def test_where_the_likeliest_view_does_not_explain_a_clip_the_others_are_tried(throw: UserClip) -> None:
    flow = np.zeros((SCHEDULE.model_frames, 320, 480, 2), np.float32)
    clip = MeasuredClip(throw, SCHEDULE, flow, None, ())
    evaluator = clip_evaluator(throw.masks, flow, SCHEDULE, (120, 80), 1)
    wrong = seen_as(filmed_world(throw, World()), "top")
    assert wrong is not None
    found, method = from_tracks(wrong, evaluator, clip, World(), searched=False)
    assert found.motion.view.kind in ("flight", "side")
    assert "top" in found.motion.view.reason
    assert method is not None
    assert method.overlap.sequence > 0.7
    asked, _ = from_tracks(wrong, evaluator, clip, World(view="top"), searched=False)
    assert asked.motion.view.kind == "top"


def test_a_body_that_the_compared_frames_do_not_show_does_not_stop_a_search() -> None:
    other = replace(THROW.objects[0], position=(0.8, 0.5, -0.2), velocity=(-1.0, 0, 3.0))
    two = replace(THROW, objects=(*THROW.objects, other))
    masks = clip_of(two).masks
    compared = masks[SCHEDULE.pairs[:, 0]]
    compared[compared == 2] = 0
    masks[SCHEDULE.pairs[:, 0]] = compared
    assert 2 in masks
    flow = np.zeros((SCHEDULE.model_frames, 320, 480, 2), np.float32)
    evaluator = clip_evaluator(masks, flow, SCHEDULE, (120, 80), 1)
    found = search_clip(evaluator, [two], 200, np.random.default_rng(0))
    assert found.result.iou > 0.3


def test_a_known_size_gives_the_scale(throw: UserClip) -> None:
    found = fitted(throw, World.of(size=(0, "radius", 0.08)))
    assert found.answer is not None
    assert found.answer.scale.by == "size"
    assert found.answer.scale.px_per_m == pytest.approx(200, rel=0.03)
    assert -found.answer.scene.gravity[2] == pytest.approx(9.81, rel=0.04)
    with pytest.raises(ParamsError, match="no body 3"):
        filmed_world(throw, World.of(size=(3, "radius", 0.08)))


def test_slow_motion_is_told_by_what_falls(throw: UserClip) -> None:
    assert filmed_world(throw, World.of(size=(0, "radius", 0.08))).doubts == ()
    (doubt,) = filmed_world(throw, World.of(size=(0, "radius", 0.005))).doubts
    assert "frames a second (--fps)" in doubt


def test_free_fall_that_disagrees_with_gravity_is_a_doubt() -> None:
    assert gravity_doubt(9.5, 9.81, 0.01, 30.0) is None
    assert gravity_doubt(8.5, 9.81, 0.05, 30.0) is None
    assert "240 frames" in (gravity_doubt(9.81 / 64, 9.81, 0.01, 30.0) or "")
    assert "the length may be wrong" in (gravity_doubt(11.5, 9.81, 0.01, 30.0) or "")


def test_a_length_needs_two_points() -> None:
    with pytest.raises(ParamsError, match="two points"):
        World.of(length=(10, 20, 10, 20, 1.0))


def test_measured_tracks_are_in_the_scenes_metres(throw: UserClip) -> None:
    tracks = image_tracks(throw.masks, TIMES)
    (ball,) = body_tracks(THROW, objects_of(np.array([[0, 0]]), False, tracks), 480, 320)
    assert np.abs(ball.position - ball.replayed).max() < 0.01
    assert ball.position[:, 1] == pytest.approx(0, abs=1e-9)
    wrong = replace(THROW, objects=(replace(THROW.objects[0], velocity=(1.4, 0, 3.0)),))
    (moved,) = body_tracks(wrong, dict(enumerate(tracks)), 480, 320)
    assert np.abs(moved.position - ball.position).max() < 0.01  # measured, whatever the replay does
    table = track_table("throw", [ball])
    assert table.column_names[:6] == ["clip", "object", "time", "x", "y", "z"]
    assert set(table["object"].to_pylist()) == {"sphere_0"}


def test_a_box_that_slides_is_measured_with_its_angle_and_honest_errors() -> None:
    turn = Rotation.from_euler("y", 25, degrees=True)
    thrown = SceneObject("box", (0.3, 0.1, 0.12), 1.0, position=(-0.7, 0, 0.2), velocity=(1.5, 0, 1.5))
    tilted = replace(thrown, orientation=tuple(turn.as_quat(scalar_first=True)))
    camera = Plane(480, 320, 200.0).camera()
    shown = replay_poses(Scene((tilted,), camera, ground=None), SCHEDULE)
    tracks = dict(enumerate(image_tracks(shown.masks, TIMES)))
    (box,) = body_tracks(
        Scene((thrown,), camera, ground=None), tracks, 480, 320
    )  # whose replay does not know the angle
    use = np.searchsorted(TIMES, box.times)
    errors = (box.position - shown.position[use, 0])[:, [0, 2]]
    assert np.abs(errors).max() < 4 * box.sigma.max()
    found = Rotation.from_quat(box.quaternion, scalar_first=True) * turn.inv()
    assert found.magnitude().max() < 0.05
    assert box.angle_sigma.max() < 0.1


def test_tracks_of_the_videos_own_picture_are_brought_into_the_clip() -> None:
    masks = np.zeros((8, 480, 640), np.uint8)
    masks[:, 200:240, 300:340] = 1
    (track,) = image_tracks(masks, np.arange(8) / 30)
    moved = clip_track(track, Letterbox((640, 480), (480, 320), (26, 0, 427, 320)))
    assert moved.centre[0] == pytest.approx([26 + 320 * 427 / 640, 220 * 427 / 640], abs=0.1)


def test_the_last_third_is_forecast_and_short_clips_are_not() -> None:
    shown = np.ones((30, 2, 2), np.uint8)
    assert fitted_frames(TIMES, shown) == 21
    assert fitted_frames(np.arange(5) / 30, shown[:5]) == 0


def test_what_is_forecast_is_in_view() -> None:
    left = np.ones((30, 2, 2), np.uint8)
    left[15:] = 0  # the body has left the picture
    assert fitted_frames(TIMES, left) == fitted_frames(TIMES[:15], left[:15]) == 10
    assert fitted_frames(TIMES, 0 * left) == 0


@pytest.mark.parametrize(
    ("iou", "forecast", "name"),
    [
        (0.9, Forecast(0.7, 0.8, 0.3), "good"),
        (0.9, Forecast(0.7, 0.3, 0.8), "doubtful"),
        (0.6, Forecast(0.7, 0.8, 0.3), "doubtful"),
        (0.9, None, "doubtful"),
        (0.3, Forecast(0.7, 0.8, 0.3), "poor"),
    ],
)
def test_the_grade_says_why(iou: float, forecast: Forecast | None, name: str) -> None:
    graded = grade(iou, forecast)
    assert graded.name == name
    assert graded.reason


@pytest.mark.parametrize(("iou", "well"), [(0.8, True), (0.17, False)])
def test_a_good_grade_says_where_the_forecast_is_better_but_not_good(iou: float, well: bool) -> None:
    graded = grade(0.9, Forecast(0.7, iou, 0.03))
    assert graded.name == "good"
    assert ("though not well" in graded.reason) != well
