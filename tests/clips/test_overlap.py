"""The definitions of formats.md, section 5, on masks made by hand."""

import numpy as np
import pytest

from pipeline.clips.overlap import (
    Counts,
    assign,
    count,
    foreground_iou,
    pair_iou,
    sequence_iou,
)


def masks(*frames: str) -> np.ndarray:
    """Frames (F, 1, W) from strings of digits, 0 or a space for the background."""
    return np.array([[[int(c) for c in frame.replace(" ", "0")]] for frame in frames], np.uint8)


def score(predicted: np.ndarray, true: np.ndarray) -> float:
    counts = counted(predicted, true)
    return sequence_iou(counts, assign(pair_iou(counts)))


def counted(predicted: np.ndarray, true: np.ndarray) -> Counts:
    return count(predicted, true, int(predicted.max()), int(true.max()))


def test_counts_are_the_pixels_shared_and_of_each() -> None:
    counts = counted(masks("112200"), masks("111022"))
    np.testing.assert_array_equal(counts.shared, [[[2, 0], [1, 0]]])
    np.testing.assert_array_equal(counts.predicted, [[2, 2]])
    np.testing.assert_array_equal(counts.true, [[3, 2]])
    np.testing.assert_array_equal(counts.foreground, [[3, 6]])


def test_the_same_masks_score_one_whatever_the_numbers_of_the_instances() -> None:
    true = masks("11022033", "01122330")
    assert score(true, true) == 1
    renumbered = np.array([0, 3, 1, 2], np.uint8)[true]
    assert score(renumbered, true) == 1


def test_the_score_does_not_depend_on_the_order_of_the_instances(rng: np.random.Generator) -> None:
    predicted, true = rng.integers(0, 4, (2, 5, 8, 8)).astype(np.uint8)
    order = np.concatenate([[0], 1 + rng.permutation(3)]).astype(np.uint8)
    assert score(order[predicted], true) == pytest.approx(score(predicted, true))
    assert score(predicted, order[true]) == pytest.approx(score(predicted, true))


def test_predicted_and_true_may_change_places(rng: np.random.Generator) -> None:
    predicted, true = rng.integers(0, 3, (2, 4, 6, 6)).astype(np.uint8)
    assert score(true, predicted) == pytest.approx(score(predicted, true))


def test_one_assignment_serves_the_whole_clip() -> None:
    """Instances that swap places half way match in the frames that weigh more, not in each by itself."""
    true = masks("1122", "1122", "1122")
    predicted = masks("1122", "1122", "2211")
    assert score(predicted, true) == pytest.approx(2 / 3)


def test_an_instance_without_a_partner_counts_zero() -> None:
    true = masks("1100")
    assert score(masks("1102"), true) == pytest.approx(1 / 2)
    assert score(true, masks("1102")) == pytest.approx(1 / 2)
    assert score(masks("1123"), true) == pytest.approx(1 / 3)


def test_an_instance_that_is_never_seen_is_left_out() -> None:
    true, predicted = masks("1100"), masks("1100")
    counts = count(predicted, true, 3, 1)
    assert sequence_iou(counts, assign(pair_iou(counts))) == 1


def test_frames_in_which_both_masks_are_empty_are_left_out() -> None:
    true = masks("1100", "0000", "0000", "1100")
    predicted = masks("1000", "0000", "0000", "1100")
    assert score(predicted, true) == pytest.approx((1 / 2 + 1) / 2)
    late = masks("1000", "0000", "0011", "1100")  # seen where the true one is not: zero there
    assert score(late, true) == pytest.approx((1 / 2 + 0 + 1) / 3)


def test_clips_without_anything_score_zero() -> None:
    empty = np.zeros((3, 4, 4), np.uint8)
    counts = count(empty, empty, 1, 1)
    assert sequence_iou(counts, assign(pair_iou(counts))) == 0
    assert foreground_iou(counts) == 0
    counts = count(empty, empty, 0, 2)
    assert sequence_iou(counts, assign(pair_iou(counts))) == 0


def test_the_first_frame_is_scored_with_the_clips_assignment() -> None:
    true = masks("1122", "1122", "1122")
    predicted = masks("2211", "1122", "1122")
    counts = counted(predicted, true)
    pairs = assign(pair_iou(counts))
    assert sequence_iou(counts.frames(slice(1)), pairs) == 0
    assert sequence_iou(counts, pairs) == pytest.approx(2 / 3)


def test_the_foreground_is_the_union_of_all_objects() -> None:
    assert foreground_iou(counted(masks("2211"), masks("1122"))) == 1
    assert foreground_iou(counted(masks("1200", "0000"), masks("0110", "0000"))) == pytest.approx(1 / 3)


def test_the_assignment_maximises_the_summed_overlap(rng: np.random.Generator) -> None:
    iou = rng.random((4, 3, 3))
    pairs = assign(iou)
    best = iou.sum(0)[pairs[:, 0], pairs[:, 1]].sum()
    for order in ([0, 1, 2], [1, 0, 2], [2, 1, 0], [0, 2, 1], [1, 2, 0], [2, 0, 1]):
        assert iou.sum(0)[range(3), order].sum() <= best + 1e-12


def test_masks_of_another_size_or_with_more_bodies_are_refused() -> None:
    one = np.ones((2, 4, 6), np.uint8)
    with pytest.raises(ValueError, match=r"\(2, 4, 6\) and \(2, 4, 3\)"):
        count(one, one[..., :3], 1, 1)
    with pytest.raises(ValueError, match="more than the 1 and 1"):
        count(one * 2, one, 1, 1)
