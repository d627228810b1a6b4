"""Motion measured from the masks of several clips of one camera."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.discovery.filmed.measured_motion import MeasuredMotion, measure_motion
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.discovery.tracks.known_scene import KnownScene, known_scene
from pipeline.errors import MeasurementError
from pipeline.scene.scene import Camera
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise

TIMES = np.arange(24) / 30
CAMERA = Camera((0.1, -1.9, 1.7), 42.0, pitch=-41.0)
BALL = {"objects": [{"name": "ball", "shape": "sphere", "radius": 0.07, "mass": 0.2}]}
WAYS = ((0.9, 0.3), (-0.4, 0.8), (0.2, -0.9), (-0.9, -0.2))


def rolling(known: KnownScene, way: tuple[float, float]) -> np.ndarray:
    """(T, 3) m, a ball that rolls at constant speed through the middle."""
    path = (TIMES - TIMES.mean())[:, None] * np.array(way)
    return np.column_stack([path, np.full(len(TIMES), known.scene.objects[0].size[0])])


def filmed(known: KnownScene, way: tuple[float, float], name: str) -> RecordedClip:
    place = rolling(known, way)[:, None]
    turn = np.tile([1.0, 0, 0, 0], (len(TIMES), 1, 1))
    masks = rasterise(known.scene.objects, place, turn, pinhole(CAMERA), 480, 320, 0.0, ()).mask
    return RecordedClip(name, np.zeros((*masks.shape, 3), np.uint8), masks, TIMES)


@pytest.fixture(scope="module")
def ball() -> KnownScene:
    return known_scene(BALL)


@pytest.fixture(scope="module")
def measured(ball: KnownScene) -> MeasuredMotion:
    return measure_motion([filmed(ball, way, f"clip_{i}") for i, way in enumerate(WAYS)], ball)


def with_shadow(clip: RecordedClip) -> RecordedClip:
    """The clip with masks that hold a part of the ball's shadow in some frames, and lack the ball's top in others."""
    masks = clip.masks.copy()
    for k in range(len(masks)):
        rows, cols = np.nonzero(clip.masks[k])
        radius = np.sqrt(len(rows) / np.pi)
        y, x = np.mgrid[: masks.shape[1], : masks.shape[2]]
        if k % 3 == 0:
            below = np.hypot(x - cols.mean() - 0.3 * radius, y - rows.mean() - 0.7 * radius) < radius
            masks[k][below] = 1
        elif k % 3 == 1:
            masks[k][: int(rows.min() + 0.3 * radius)] = 0
    return replace(clip, masks=masks)


def test_shadows_and_gaps_of_some_frames_hardly_move_a_track(measured: MeasuredMotion, ball: KnownScene) -> None:
    shown = measure_motion([with_shadow(clip) for clip in measured.clips], ball)
    for found, clean in zip(shown.tracks, measured.tracks, strict=True):
        at = np.searchsorted(clean.time, found.time - 1e-6)
        jump = np.diff(found.position - clean.position[at], axis=0)
        assert np.sqrt((jump**2).sum(1).mean()) < 0.15 * ball.scene.objects[0].size[0]


def test_positions_are_true_within_what_is_not_known_of_the_camera(measured: MeasuredMotion, ball: KnownScene) -> None:
    off, slopes = [], []
    for track, way in zip(measured.tracks, WAYS, strict=True):
        true = rolling(ball, way)[np.searchsorted(TIMES, track.time - 1e-6)]
        off.append((track.position - true)[:, :2])
        assert track.camera_error is not None
        one = replace(track.camera_error, slope=track.camera_error.slope[None], bend=track.camera_error.bend[None])
        slopes.append(one.derivative(track.position[None], np.zeros(one.count))[0, :, :2])
    error, slope = np.concatenate(off), np.concatenate(slopes)
    place = np.concatenate([t.position[:, :2] for t in measured.tracks])
    # the frame's origin and its turn about the vertical are conventions
    free = np.concatenate(
        [np.eye(2)[None].repeat(len(place), 0), np.stack([-place[:, 1], place[:, 0]], 1)[..., None]], 2
    )
    design = np.concatenate([slope, free], 2).reshape(2 * len(place), -1)
    found = np.linalg.lstsq(design, error.ravel(), rcond=None)[0]
    left = error.ravel() - design @ found
    assert np.sqrt((left**2).mean()) < 1e-3  # m
    assert np.abs(found[: slope.shape[2]]).max() < 4  # standard deviations


@pytest.mark.parametrize(("speed", "moves"), [(0.04, True), (0.005, False)])
def test_a_clip_in_which_a_single_body_rests_is_left_out(ball: KnownScene, speed: float, moves: bool) -> None:
    clips = [filmed(ball, way, f"clip_{i}") for i, way in enumerate((*WAYS[:2], (speed, 0.0)))]
    found = measure_motion(clips, ball)
    assert [clip.name for clip in found.clips] == ["clip_0", "clip_1", *["clip_2"] * moves]
    assert any("no body moves" in note and "clip_2" in note for note in found.notes) != moves


def test_clips_of_different_sizes_are_refused(ball: KnownScene) -> None:
    one = filmed(ball, WAYS[0], "one")
    other = replace(one, name="other", masks=one.masks[:, :200], frames=one.frames[:, :200])
    with pytest.raises(MeasurementError, match="one camera"):
        measure_motion([one, other], ball)


def test_more_objects_than_bodies_are_refused(ball: KnownScene) -> None:
    two = {"objects": [BALL["objects"][0], BALL["objects"][0] | {"name": "other"}]}
    with pytest.raises(MeasurementError, match=r"clip one: 1 moving bodies for the 2 objects"):
        measure_motion([filmed(ball, WAYS[0], "one")], known_scene(two))


def test_boxes_are_refused(ball: KnownScene) -> None:
    box = {"objects": [{"name": "box", "shape": "box", "width": 0.1, "depth": 0.1, "height": 0.1, "mass": 1}]}
    with pytest.raises(MeasurementError, match="cannot be followed"):
        measure_motion([filmed(ball, WAYS[0], "one")], known_scene(box))
