"""Laws of registration: a motion with a known error in the picture is brought back to the masks, seen whole or not."""

import numpy as np

from pipeline.editing.camera_rays import NOBODY, cast_bodies
from pipeline.editing.registration import identity, register
from pipeline.editing.view import BodyMotion, View, view_of
from pipeline.scene.scene import Camera, Scene, SceneObject

WIDTH, HEIGHT, FRAMES = 120, 80, 8
ACROSS = 0.02  # m, the error: its body is that much too far to the right, seen from 2 m away


def view() -> View:
    return view_of(Scene((), Camera((0.0, -2.0, 0.5), 40.0, 0.0)), WIDTH, HEIGHT)


def motion(*tracks: np.ndarray) -> BodyMotion:
    """Balls along tracks (T, 3)."""
    balls = tuple(SceneObject("sphere", (0.15,), 1.0, name=f"ball_{i}") for i in range(len(tracks)))
    position = np.stack(tracks, axis=1)
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (*position.shape[:2], 1))
    return BodyMotion(balls, position, turn, np.ones(position.shape[:2], bool))


def masks(shown: BodyMotion) -> np.ndarray:
    """(T, H, W) uint8, as a clip of the motion has them."""
    out = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    corrections, rectangles = identity(shown, view()), shown.rectangles(view())
    for t in range(FRAMES):
        ids, depth = np.empty((HEIGHT, WIDTH), np.uint8), np.empty((HEIGHT, WIDTH), np.float32)
        point = np.empty((HEIGHT, WIDTH, 3), np.float32)
        cast_bodies(
            shown.tables[t], corrections[t], rectangles[t], shown.shown[t], *view().ray_arguments, ids, depth, point
        )
        out[t] = np.where(ids == NOBODY, 0, ids + 1)
    return out


def track(first: float, last: float, depth: float = 0.0, across: float = 0.0) -> np.ndarray:
    """(T, 3) m, across the picture."""
    x = np.linspace(first, last, FRAMES) + across
    return np.stack([x, np.full(FRAMES, depth), np.full(FRAMES, 0.5)], axis=1)


def error_px(true: BodyMotion, found: BodyMotion) -> np.ndarray:
    """(T, N) px between the true centres and the corrected ones."""
    corrections, _ = register(found, view(), masks(true))
    shown = corrections[..., :2] + corrections[..., 2:4]
    return np.linalg.norm(shown - true.centres_px(view()), axis=-1)


def test_a_body_that_is_seen_whole_is_brought_to_its_mask() -> None:
    error = error_px(motion(track(-0.3, 0.3)), motion(track(-0.3, 0.3, across=ACROSS)))
    assert error.max() < 0.3


def test_a_body_that_leaves_the_picture_is_brought_to_what_is_seen_of_it() -> None:
    true, found = motion(track(0.98, 1.1)), motion(track(0.98, 1.1, across=6 * ACROSS))
    assert (masks(true)[:, :, -1] > 0).any(1).all()  # cut by the border in every frame
    assert error_px(true, found).max() < 2.0


def test_a_body_behind_another_one_is_brought_to_what_is_seen_of_it() -> None:
    front = track(0.1, 0.1, depth=-0.5)
    true, found = motion(front, track(-0.1, -0.1)), motion(front, track(-0.1, -0.1, across=2 * ACROSS))
    assert error_px(true, found)[:, 1].max() < 1.0


def test_a_body_without_a_mask_stays_where_the_scene_has_it() -> None:
    found = motion(track(-0.3, 0.3))
    corrections, measured = register(found, view(), np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8))
    assert not measured.any()
    np.testing.assert_allclose(corrections, identity(found, view()))
