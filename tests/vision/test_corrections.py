"""Lens distortion and a camera's shake are taken out of frames, and what cannot be corrected is refused."""

import cv2
import numpy as np
import pytest

from pipeline.errors import ParamsError, VideoError
from pipeline.vision.recordings.corrections import Correction, undistorted, without_shake

WIDTH, HEIGHT = 240, 160


def backdrop(seed: int) -> np.ndarray:
    """(H, W, 3) uint8 with texture of all sizes."""
    rng = np.random.default_rng(seed)
    picture = sum(
        cv2.resize(rng.uniform(-40, 40, (c * 2 // 3, c, 3)), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        for c in (6, 15, 40)
    )
    return np.clip(picture + 125, 0, 255).astype(np.uint8)


def shaken(picture: np.ndarray, shifts: np.ndarray, angles_deg: np.ndarray) -> np.ndarray:
    """Frames of a camera that shifts by (T, 2) px and rolls."""
    out = []
    for (dx, dy), angle in zip(shifts, angles_deg, strict=True):
        turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle, 1.0)
        turn[:, 2] += dx, dy
        out.append(cv2.warpAffine(picture, turn, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE))
    return np.stack(out)


def test_lines_that_a_lens_bends_become_straight() -> None:
    k, size = -0.15, np.hypot(WIDTH, HEIGHT) / 2
    frames = np.zeros((1, HEIGHT, WIDTH, 3), np.uint8)
    true = np.stack([np.linspace(20, 220, 60), np.full(60, 30.0)], 1) - [WIDTH / 2, HEIGHT / 2]
    radius = np.linalg.norm(true, axis=1, keepdims=True) / size
    for x, y in true * (1 + k * radius**2) + [WIDTH / 2, HEIGHT / 2]:
        cv2.circle(frames[0], (round((x - 0.5) * 16), round((y - 0.5) * 16)), 32, (255, 255, 255), -1, cv2.LINE_AA, 4)
    assert np.ptp(_heights(frames[0])) > 2
    assert np.ptp(_heights(undistorted(frames, k)[0])) < 0.5


def _heights(frame: np.ndarray) -> np.ndarray:
    """px, of a bright line in each of some columns."""
    columns = frame[:, 40:200:10, 0].astype(float)
    return np.asarray((np.arange(HEIGHT)[:, None] * columns).sum(0) / columns.sum(0))


def test_a_camera_that_shakes_is_held_still_and_a_body_keeps_its_motion() -> None:
    rng = np.random.default_rng(3)
    shifts, angles = rng.normal(0, 3, (12, 2)), rng.normal(0, 0.7, 12)
    shifts[0], angles[0] = 0, 0
    picture = backdrop(1)
    path = np.linspace((60, 80), (180, 70), 12)
    own = []
    for (x, y), frame in zip(path, np.repeat(picture[None], 12, 0), strict=True):
        own.append(cv2.circle(frame.copy(), (round(x), round(y)), 12, (240, 40, 30), -1))
    frames = np.stack([shaken(f, shifts[k : k + 1], angles[k : k + 1])[0] for k, f in enumerate(own)])
    held, most = without_shake(frames)
    inside = np.s_[:, 15:-15, 15:-15]
    assert 4 < most < 20
    assert np.abs(held[inside].astype(float) - np.stack(own)[inside]).mean() < 4
    assert np.abs(frames[inside].astype(float) - np.stack(own)[inside]).mean() > 8


def test_what_is_corrected_is_said() -> None:
    frames = shaken(backdrop(2), np.array([[0, 0], [2, 1]]), np.zeros(2))
    _, notes = Correction(-0.1, steady=True).apply(frames)
    assert [("--distortion" in n, "--steady" in n) for n in notes] == [(True, False), (False, True)]
    kept, none = Correction().apply(frames)
    assert kept is frames
    assert none == []


def test_what_cannot_be_corrected_is_refused() -> None:
    with pytest.raises(ParamsError, match=r"--distortion 0.5: valid: -0.3 to 0.3"):
        Correction(0.5)
    with pytest.raises(ParamsError, match="--distortion nan"):
        Correction(float("nan"))
    with pytest.raises(VideoError, match="too few corners"):
        without_shake(np.full((3, HEIGHT, WIDTH, 3), 90, np.uint8))
