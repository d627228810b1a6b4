"""What clicks do to masks."""

import numpy as np
import pytest

from pipeline.app.body_masks import BodyMasks, added, body_at, dropped, joined, outlines, split
from pipeline.errors import ParamsError


def two_discs(frames: int = 12) -> np.ndarray:
    """(T, 60, 100) Two discs of radius 8 px that touch in the first frame and part; both are body 1."""
    rows, cols = np.mgrid[:60, :100] + 0.5
    masks = np.zeros((frames, 60, 100), np.uint8)
    for t in range(frames):
        for x in (42 - 2.5 * t, 58 + 2.5 * t):
            masks[t][np.hypot(cols - x, rows - 30) < 8] = 1
    return masks


def test_a_click_means_the_body_below_it_or_close_to_it() -> None:
    masks = two_discs()
    assert body_at(masks, 0, (42, 30)) == 1
    assert body_at(masks, 0, (42, 30 - 8 - 4)) == 1
    with pytest.raises(ParamsError, match="no body at that place"):
        body_at(masks, 0, (5, 5))


@pytest.mark.parametrize("frame", [0, 5, 11])
def test_a_split_follows_both_parts_through_all_frames(frame: int) -> None:
    masks = two_discs()
    lefts = 42 - 2.5 * frame, 58 + 2.5 * frame
    out = split(masks, frame, (lefts[0], 30), (lefts[1], 30))
    np.testing.assert_array_equal(out > 0, masks > 0)
    for t in range(len(masks)):
        centres = [np.nonzero(out[t] == k)[1].mean() + 0.5 for k in (1, 2)]
        np.testing.assert_allclose(centres, [42 - 2.5 * t, 58 + 2.5 * t], atol=0.6)


def test_joining_undoes_a_split() -> None:
    masks = two_discs()
    out = split(masks, 0, (40, 30), (60, 30))
    np.testing.assert_array_equal(joined(out, 1, 2), masks)
    np.testing.assert_array_equal(joined(out, 2, 1), masks)


def test_numbers_stay_1_to_n_and_every_change_can_be_undone() -> None:
    first = BodyMasks(split(two_discs(), 0, (40, 30), (60, 30)))
    ball = np.zeros(first.masks.shape, bool)
    ball[:, :5, :5] = True
    three = first.changed(added(first.masks, ball))
    assert three.count == 3
    two = three.changed(dropped(three.masks, 1))
    assert sorted(np.unique(two.masks)) == [0, 1, 2]
    assert two.masks[0, 0, 0] == 2
    np.testing.assert_array_equal(two.undone().undone().masks, first.masks)
    with pytest.raises(ParamsError, match="nothing to undo"):
        first.undone()


def test_clicks_that_mean_nothing_are_refused() -> None:
    masks = two_discs()
    parted = split(masks, 0, (40, 30), (60, 30))
    with pytest.raises(ParamsError, match="only body"):
        dropped(masks, 1)
    with pytest.raises(ParamsError, match="same body"):
        joined(masks, 1, 1)
    with pytest.raises(ParamsError, match="two bodies"):
        split(parted, 0, (40, 30), (60, 30))
    with pytest.raises(ParamsError, match="same place"):
        split(masks, 0, (40, 30), (41, 30))
    with pytest.raises(ParamsError, match="no body was found"):
        added(masks, np.zeros(masks.shape, bool))


def test_outlines_surround_each_body() -> None:
    found = outlines(split(two_discs(), 0, (40, 30), (60, 30)))
    xs = [np.array(found[0][k][0][::2]) for k in (0, 1)]
    assert len(found) == 12
    assert len(found[0]) == 2
    assert xs[0].max() <= xs[1].min() + 1
