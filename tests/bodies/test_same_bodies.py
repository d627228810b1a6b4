"""Pieces that are one body, and bodies whose numbers masks exchange, in drawn clips."""

import numpy as np
import pytest

from pipeline.bodies.tracks.exchanged_bodies import without_exchanges
from pipeline.bodies.tracks.rigid_pieces import joined_pieces

TIMES = np.arange(30) / 30
HEIGHT, WIDTH = 60, 200


def drawn(places: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(T, H, W) bool: an upright rectangle, size (w, h) px, about places (T, 2) px."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    off = np.stack([x, y], -1) - np.asarray(places)[:, None, None]
    return np.asarray((np.abs(off) < 0.5 * np.array(size)).all(-1))


def there_and_back(x: float) -> np.ndarray:
    return np.stack([x + 80 * (1 - np.abs(2 * TIMES / TIMES[-1] - 1)), np.full(len(TIMES), 30.0)], 1)


def clip_with(masks: np.ndarray, more: np.ndarray | None = None) -> np.ndarray:
    """Frames in which masks are dark on a pale background, and `more` is grey."""
    frames = np.full((*masks.shape, 3), 230, np.uint8)
    if more is not None:
        frames[more] = 180
    frames[masks > 0] = 40
    return frames


def ends() -> np.ndarray:
    left, right = (drawn(there_and_back(x), (8, 14)) for x in (20, 70))
    return np.where(left, 1, np.where(right, 2, 0)).astype(np.uint8)


def test_two_ends_of_a_bar_that_turn_back_together_are_one_body() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    joined, groups = joined_pieces(masks, clip_with(masks, bar), TIMES, [False, False])
    assert groups == [[1, 2]]
    assert (joined[bar | (masks > 0)] == 1).mean() > 0.95


def test_an_end_that_is_two_bodies_one_after_the_other_is_one_end() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    masks[:8][masks[:8] == 2] = 3
    assert joined_pieces(masks, clip_with(masks, bar), TIMES, [False] * 3)[1] == [[1, 2, 3]]


def test_the_middle_of_a_stiff_body_is_filled() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    masks[masks == 2] = 1
    filled, groups = joined_pieces(masks, clip_with(masks, bar), TIMES, [False], [True])
    assert groups == [[1]]
    assert (filled[bar | (masks > 0)] == 1).mean() > 0.95


def test_a_body_that_passes_a_bar_stays_a_body() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    passing = drawn(np.stack([np.linspace(190, 150, 30), np.full(30, 10.0)], 1), (8, 8))
    masks[passing & (np.arange(30) < 8)[:, None, None]] = 3
    assert joined_pieces(masks, clip_with(masks, bar | (masks == 3)), TIMES, [False] * 3)[1] == [[1, 2], [3]]


def test_two_bodies_with_background_between_them_stay_two() -> None:
    masks = ends()
    same, groups = joined_pieces(masks, clip_with(masks), TIMES, [False, False])
    assert groups == [[1], [2]]
    assert (same == masks).all()


@pytest.mark.parametrize("backwards", [False, True])
def test_two_bodies_that_go_one_way_side_by_side_stay_two(backwards: bool) -> None:
    way = np.stack([80 * TIMES[:: -1 if backwards else 1], np.full(len(TIMES), 30.0)], 1)
    left, right, shadow = (drawn(way + np.array([x, 0]), (w, 14)) for x, w in ((20, 20), (55, 20), (37, 40)))
    masks = np.where(left, 1, np.where(right, 2, 0)).astype(np.uint8)
    assert joined_pieces(masks, clip_with(masks, shadow), TIMES, [False, False])[1] == [[1], [2]]


def test_touching_parts_that_turn_back_together_are_one_body_though_their_numbers_change() -> None:
    left, middle, right = (drawn(there_and_back(x), (w, 14)) for x, w in ((25, 10), (50, 40), (75, 10)))
    masks = np.where(left, 1, np.where(middle, 2, np.where(right, 3, 0))).astype(np.uint8)
    masks[18:][masks[18:] == 3] = 4
    assert joined_pieces(masks, clip_with(masks), TIMES, [False] * 4)[1] == [[1, 2, 3, 4]]


def test_a_body_that_is_pushed_to_another_and_back_alone_stays_a_body() -> None:
    x = 20 + 80 * (1 - np.abs(2 * TIMES / TIMES[-1] - 1))
    one, other = (drawn(np.stack([a, np.full(30, 30.0)], 1), (14, 14)) for a in (x, np.maximum(x[15] + 14, x + 14)))
    masks = np.where(one, 1, np.where(other, 2, 0)).astype(np.uint8)
    assert joined_pieces(masks, clip_with(masks), TIMES, [False] * 2)[1] == [[1], [2]]


@pytest.mark.parametrize("same_number", [True, False])
def test_a_body_of_which_only_an_end_is_found_is_completed(same_number: bool) -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    masks[:4][masks[:4] == 2] = 0
    if not same_number:  # the end that is found has the number that the other end has later
        masks[:4][masks[:4] == 1] = 2
    joined, groups = joined_pieces(masks, clip_with(ends(), bar), TIMES, [False, False])
    assert groups == [[1, 2]]
    whole = joined_pieces(ends(), clip_with(ends(), bar), TIMES, [False, False])[0]
    assert ((joined > 0) != (whole > 0)).sum() < 0.02 * (whole > 0).sum()


@pytest.mark.parametrize("seen_at_first", [0, 1, 2])
def test_a_stiff_body_is_followed_where_little_or_nothing_of_it_is_found(seen_at_first: int) -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    end = masks == seen_at_first
    masks[:8] = 0
    masks[:8][end[:8] & (seen_at_first > 0)] = 3
    joined, groups = joined_pieces(masks, clip_with(ends(), bar), TIMES, [False] * 3)
    assert groups == [[1, 2, 3] if seen_at_first else [1, 2]]
    whole = joined_pieces(ends(), clip_with(ends(), bar), TIMES, [False, False])[0]
    assert ((joined > 0) != (whole > 0)).sum() < 0.05 * (whole > 0).sum()


def test_a_stiff_body_is_not_followed_to_where_it_is_not() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    seen = clip_with(masks, bar)
    masks[:8] = 0
    seen[:8] = clip_with(masks)[:8]
    assert not joined_pieces(masks, seen, TIMES, [False, False])[0][:8].any()


def test_a_part_without_the_rest_of_its_body_is_left_out() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    masks[:4][masks[:4] == 2] = 0
    seen = clip_with(ends(), bar)
    seen[:4] = clip_with(masks)[:4]
    assert not joined_pieces(masks, seen, TIMES, [False, False])[0][:4].any()


def test_bodies_that_the_user_named_stay_two() -> None:
    masks, bar = ends(), drawn(there_and_back(45), (50, 12))
    assert joined_pieces(masks, clip_with(masks, bar), TIMES, [True, True])[1] == [[1], [2]]


def struck() -> tuple[np.ndarray, np.ndarray]:
    """Places (T, 2) of a puck that stops at frame 15 and of the puck that it hits."""
    x = 20 + 4.0 * np.minimum(np.arange(30), 15)
    other = 92 + 4.0 * np.maximum(np.arange(30) - 15, 0)
    return np.stack([x, np.full(30, 30.0)], 1), np.stack([other, np.full(30, 30.0)], 1)


def test_numbers_that_are_exchanged_where_pucks_hit_are_put_right() -> None:
    first, second = (drawn(p, (12, 12)) for p in struck())
    true = np.where(first, 1, np.where(second, 2, 0)).astype(np.uint8)
    wrong = true.copy()
    wrong[16:] = np.array([0, 2, 1], np.uint8)[true[16:]]
    assert (without_exchanges(wrong, clip_with(true), TIMES) == true).all()
    assert (without_exchanges(true, clip_with(true), TIMES) == true).all()


def test_bodies_of_different_colours_keep_the_numbers_that_they_have() -> None:
    first, second = (drawn(p, (12, 12)) for p in struck())
    masks = np.where(first, 1, np.where(second, 2, 0)).astype(np.uint8)
    masks[16:] = np.array([0, 2, 1], np.uint8)[masks[16:]]
    frames = clip_with(masks)
    frames[masks == 2] = (200, 30, 30)
    assert (without_exchanges(masks, frames, TIMES) == masks).all()
