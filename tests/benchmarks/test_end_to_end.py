"""Laws of the benchmark from pixels to scenes."""

import numpy as np
import pytest

from benchmarks.end_to_end import METRICS, overlap_with, summary


def test_the_true_masks_overlap_wholly_whatever_their_ids_and_size():
    truth = np.zeros((4, 160, 240), np.uint8)
    for t in range(4):
        truth[t, 20:60, 20 + 10 * t : 60 + 10 * t] = 1
        truth[t, 90:130, 150 - 10 * t : 190 - 10 * t] = 2
    assert overlap_with(truth, truth) == pytest.approx(1)
    large = np.array([0, 2, 1], np.uint8)[truth].repeat(2, 1).repeat(2, 2)
    assert overlap_with(large, truth) == pytest.approx(1)
    assert overlap_with(np.where(truth == 1, truth, 0), truth) == pytest.approx(0.5)
    assert overlap_with(np.zeros_like(truth), truth) == 0


def test_the_summary_has_a_row_for_each_clip_and_the_means():
    answers = [
        {
            "words": "now",
            "budget": 8,
            "clip": f"c{k}",
            "true": "box",
            "found": "box",
            **dict.fromkeys(METRICS, float(k)),
        }
        for k in (0, 1)
    ]
    text = summary(answers)
    assert "c0" in text and "c1" in text and "0.5 (0\u20131)" in text
