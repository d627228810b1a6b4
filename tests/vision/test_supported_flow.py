"""Laws of supported flow: what the pictures do not show is filled in, and what they show stays."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.flow_confidence import background_motion, consistency, texture
from pipeline.vision.flow.supported_flow import supported_flow, supported_pair

SIZE = (120, 80)  # px, width and height
CLOCK = np.array([0, 1 / 30]), np.array([[0, 1]])  # when two frames were recorded, and their pair
NO_BODY = np.zeros((SIZE[1], SIZE[0]), np.uint8)


def noise_picture(seed: int, blur: float = 1.5, size: tuple[int, int] = SIZE) -> np.ndarray:
    """(H, W, 3) uint8 with texture everywhere."""
    white = np.random.default_rng(seed).normal(size=(size[1], size[0], 3)).astype(np.float32)
    soft = cv2.GaussianBlur(white, (0, 0), blur)
    return np.uint8(np.clip(128 + 45 * soft / soft.std(), 0, 255))


def disc(radius: float, x: float = 60, y: float = 40, size: tuple[int, int] = SIZE) -> np.ndarray:
    rows, cols = np.mgrid[: size[1], : size[0]]
    return (cols - x) ** 2 + (rows - y) ** 2 <= radius**2


def moved(picture: np.ndarray, angle_deg: float, shift: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A picture turned about its middle and shifted, and the flow (H, W, 2) to it."""
    height, width = picture.shape[:2]
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), angle_deg, 1)
    matrix[:, 2] += shift
    rows, cols = np.mgrid[:height, :width]
    flow = np.stack([cols, rows, np.ones_like(rows)], -1) @ matrix.T - np.stack([cols, rows], -1)
    return cv2.warpAffine(picture, matrix, (width, height), flags=cv2.INTER_CUBIC), flow.astype(np.float32)


def body_on_ground(body: np.ndarray, radius: float, angle_deg: float, shift: tuple[float, float]) -> tuple:
    """Two frames of a disc with the picture `body` that moves over textured ground; its mask and its true flow."""
    ground = noise_picture(7)
    mask = disc(radius)
    after, flow = moved(body, angle_deg, shift)
    mask_after = moved(np.uint8(mask) * 255, angle_deg, shift)[0] > 127
    a, b = (np.where(m[..., None], p, ground) for m, p in ((mask, body), (mask_after, after)))
    return a, b, np.uint8(mask), flow


def test_a_plain_wall_with_flicker_has_no_flow_and_no_confidence() -> None:
    rng = np.random.default_rng(1)
    a, b = (np.uint8(np.clip(120 + 9 * k + rng.normal(0, 3, (80, 120, 3)), 0, 255)) for k in (0, 1))
    guess, back = (cv2.GaussianBlur(rng.normal(0, 30, (80, 120, 2)).astype(np.float32), (0, 0), 8) for _ in range(2))
    assert np.linalg.norm(guess, axis=-1).mean() > 1
    flow, confidence = supported_pair(a, b, guess, back, NO_BODY, SIZE)
    assert np.abs(flow).max() < 0.05
    assert confidence.max() < 0.05


def test_a_textured_body_keeps_its_flow_and_the_ground_rests() -> None:
    a, b, mask, true = body_on_ground(noise_picture(3), 16, 0, (2, 1))
    frames, masks = np.stack([a, b]), np.stack([mask, mask])
    measured = DIS().flow(a[None], b[None])
    found = supported_flow(measured, frames, masks, *CLOCK, interval=1 / 30, size=SIZE)
    assert np.linalg.norm(found.flow[0] - true, axis=-1)[mask > 0].mean() < 0.1
    assert found.confidence[0][disc(12)].mean() > 0.5
    far = ~disc(26)
    assert np.linalg.norm(found.flow[0], axis=-1)[far].mean() < 0.05


def test_the_plain_inside_of_a_body_gets_the_motion_of_its_textured_rim() -> None:
    inside = disc(11)
    body = np.where(inside[..., None], 90, noise_picture(3)).astype(np.uint8)
    a, b, mask, true = body_on_ground(body, 18, 4, (2, 1))
    guess = np.where((mask > 0)[..., None] & ~inside[..., None], true, 0).astype(np.float32)
    flow, _ = supported_pair(a, b, guess, -guess, mask, SIZE)
    assert np.linalg.norm(guess - true, axis=-1)[inside].mean() > 2
    assert np.linalg.norm(flow - true, axis=-1)[disc(8)].max() < 0.25


def test_a_turning_body_is_measured_where_the_estimator_saw_it_shift_only() -> None:
    a, b, mask, true = body_on_ground(noise_picture(5, 2.5), 18, 8, (1, 0))
    guess = np.full_like(true, 0) + np.float32([1, 0])
    flow, _ = supported_pair(a, b, guess, -guess, mask, SIZE)
    assert np.linalg.norm(guess - true, axis=-1)[mask > 0].mean() > 1
    assert np.linalg.norm(flow - true, axis=-1)[mask > 0].mean() < 0.15


def test_a_body_without_any_texture_keeps_the_estimators_motion() -> None:
    flat = np.full((80, 120, 3), 128, np.uint8)
    guess = np.full((80, 120, 2), (3.0, -1.0), np.float32)
    mask = np.uint8(disc(15))
    flow, _ = supported_pair(flat, flat, guess, -guess, mask, SIZE)
    assert np.allclose(flow[mask > 0], (3, -1), atol=0.02)


def test_brightness_that_changes_does_not_move_a_body() -> None:
    a, b, mask, true = body_on_ground(noise_picture(3), 16, 0, (2, 1))
    darker = np.uint8(0.85 * b)
    flow, _ = supported_pair(a, darker, true, -true, mask, SIZE)
    assert np.linalg.norm(flow - true, axis=-1)[mask > 0].mean() < 0.15


def test_where_the_whole_background_moves_its_plain_parts_move_along() -> None:
    wall = disc(10, 90, 40)
    scene = np.where(wall[..., None], 128, noise_picture(9)).astype(np.uint8)
    b, true = moved(scene, 0, (3, 0))
    guess = np.where(disc(7, 90, 40)[..., None], 0, true).astype(np.float32)
    flow, confidence = supported_pair(scene, b, guess, -guess, NO_BODY, SIZE)
    assert np.abs(flow[disc(5, 90, 40)] - (3, 0)).max() < 0.05
    assert confidence[disc(5, 90, 40)].max() < 0.1


def test_the_background_rests_where_only_a_little_of_it_is_measured() -> None:
    flow = np.full((80, 120, 2), 2.0, np.float32)
    shadow = disc(8)
    assert np.allclose(background_motion(flow, np.where(shadow, 1.0, 0.0), np.ones((80, 120), bool)), 0)
    assert np.allclose(background_motion(flow, np.ones((80, 120)), np.ones((80, 120), bool)), 2)


def test_flow_that_does_not_return_has_no_confidence() -> None:
    flow = np.full((8, 9, 2), 4.0, np.float32)
    assert np.allclose(consistency(flow, -flow), 1)
    assert consistency(flow, 0 * flow).max() < 1e-3


def test_texture_in_one_direction_does_not_determine_flow() -> None:
    background = np.ones((80, 120), bool)
    stripes = np.broadcast_to(np.uint8(128 + 80 * np.sin(np.arange(120) / 2))[None, :, None], (80, 120, 3))
    stripes = np.ascontiguousarray(stripes)
    rest = np.zeros((80, 120, 2), np.float32)
    assert texture(stripes, stripes, rest, background)[8:-8].max() < 0.05
    picture = noise_picture(2)
    assert np.median(texture(picture, picture, rest, background)) > 0.9


def test_flow_is_in_px_of_the_frames_and_not_of_the_working_size() -> None:
    large = (240, 160)
    body, ground = noise_picture(3, 3, large), noise_picture(7, 3, large)
    mask = disc(32, 120, 80, large)
    after, true = moved(body, 5, (5, 2))
    mask_after = moved(np.uint8(mask) * 255, 5, (5, 2))[0] > 127
    a, b = (np.where(m[..., None], p, ground) for m, p in ((mask, body), (mask_after, after)))
    flow, _ = supported_pair(a, b, true, -true, np.uint8(mask), SIZE)
    assert np.linalg.norm(flow - true, axis=-1)[mask].mean() < 0.3


def test_flow_between_frames_that_were_recorded_apart_is_scaled_to_the_interval() -> None:
    a, b, mask, true = body_on_ground(noise_picture(3), 16, 0, (4, 2))
    frames, masks = np.stack([a, a, b]), np.stack([mask, mask, mask])
    recorded, pairs = np.array([0, 0, 2 / 30]), np.array([[0, 1]])  # frame 1 repeats frame 0
    found = supported_flow(0.5 * true[None], frames, masks, recorded, pairs, interval=1 / 30, size=SIZE)
    assert np.linalg.norm(found.flow[0] - true / 2, axis=-1)[mask > 0].mean() < 0.1


def test_frames_that_never_change_have_no_flow() -> None:
    a, _, mask, true = body_on_ground(noise_picture(3), 16, 0, (4, 2))
    found = supported_flow(
        0 * true[None], np.stack([a, a]), np.stack([mask] * 2), np.zeros(2), CLOCK[1], interval=1, size=SIZE
    )
    assert (found.flow == 0).all()
