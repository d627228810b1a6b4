"""Whether positions were smoothed, from the positions alone."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, filtfilt

from pipeline.discovery.tracks.smoothing import UNFILTERED, find_smoothing

RATE, NOISE = 60.0, 0.002  # 1/s, m
TIMES = [np.arange(61) / RATE] * 12


def throws(seed):
    rng = np.random.default_rng(seed)
    out = []
    for t in TIMES:
        velocity = rng.normal(0, 2, 3)
        out.append(velocity * t[:, None] - 4.9 * t[:, None] ** 2 * [0, 0, 1] + rng.normal(0, NOISE, (len(t), 3)))
    return out


def test_white_noise_and_exact_motion_were_not_smoothed():
    assert find_smoothing(TIMES, throws(0)) is None
    exact = [np.stack([np.sin(2 * t + i), np.cos(3 * t), np.exp(-t)], 1) for i, t in enumerate(TIMES)]
    assert find_smoothing(TIMES, exact) is None


@pytest.mark.parametrize("width", [1.0, 2.0, 3.0])
def test_the_width_of_a_gaussian_filter_and_the_noise_before_it(width):
    found = find_smoothing(TIMES, [gaussian_filter1d(x, width, axis=0) for x in throws(1)])
    assert found.smoothing.width == pytest.approx(width, rel=0.25)
    assert 0.5 * NOISE < found.sigma < 2 * NOISE
    assert found.smoothing.blur == pytest.approx(width / RATE, rel=0.25)


def test_a_butterworth_filter_is_told_by_the_equal_gaussian_one():
    found = find_smoothing(TIMES, [filtfilt(*butter(2, 0.2), x, axis=0) for x in throws(2)])
    assert found.smoothing.information == pytest.approx(0.17, rel=0.3)
    assert found.sigma == pytest.approx(NOISE, rel=0.5)


def test_unfiltered_samples_are_independent():
    assert UNFILTERED.information == 1.0
    assert UNFILTERED.reach == 0.0
