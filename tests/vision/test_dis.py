"""Laws of the flow by dense inverse search."""

import cv2
import numpy as np
import pytest

from pipeline.vision.flow.dis import DIS, PRESETS


def cloudy(rng, height, width):
    """A picture with structure at every scale, (H, W, 3) uint8."""
    field = sum(
        cv2.GaussianBlur(rng.standard_normal((height, width, 3)).astype(np.float32), (0, 0), s) * s for s in (1.5, 4, 9)
    )
    return np.clip(127 + 60 * field / field.std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("preset", PRESETS)
def test_equal_frames_have_no_flow(rng, preset):
    frame = cloudy(rng, 96, 128)[None]
    assert np.abs(DIS(preset).flow(frame, frame)).max() < 1e-3


@pytest.mark.parametrize("preset", PRESETS)
def test_a_shifted_picture_flows_by_the_shift(rng, preset):
    picture = cloudy(rng, 136, 176)
    dx, dy = (int(v) for v in rng.integers(-4, 5, 2))
    a, b = picture[20:-20, 24:-24], picture[20 - dy : 116 - dy, 24 - dx : 152 - dx]
    flow = DIS(preset).flow(a[None], b[None])[0, 16:-16, 16:-16]
    assert np.allclose(np.median(flow, axis=(0, 1)), [dx, dy], atol=0.3)


def test_the_flow_moves_along_with_the_pictures(rng):
    a, b = cloudy(rng, 128, 160), cloudy(rng, 128, 160)
    b[40:90, 50:110] = a[38:88, 47:107]
    b = np.where(np.abs(b.astype(int) - a) > 0, b, a)
    shift = 16  # px: a whole number of its patches at every scale
    dis = DIS("medium")
    here = dis.flow(a[None, :, :-shift], a[None, :, :-shift])[0]
    there = dis.flow(a[None, :, shift:], a[None, :, shift:])[0]
    assert np.allclose(here[:, shift:], there[:, :-shift], atol=0.05)


def test_a_smaller_working_size_gives_px_of_the_frames(rng):
    picture = cv2.resize(cloudy(rng, 80, 104), (208, 160))
    a, b = picture[10:-10, 12:-12], picture[10:-10, 8:-16]
    flow = DIS("medium").flow(a[None], b[None], size=(92, 70))[0, 20:-20, 20:-20]
    assert flow.shape == (100, 144, 2)
    assert np.allclose(np.median(flow, axis=(0, 1)), [4, 0], atol=0.3)


def test_an_unknown_preset_is_refused_with_the_valid_ones():
    with pytest.raises(ValueError, match=r"'slow'.*ultrafast, fast, medium"):
        DIS("slow")
