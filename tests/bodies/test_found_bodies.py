"""What prompts do to the bodies that the network finds."""

import drawn_clips
import numpy as np
import pytest

from pipeline.bodies.found_bodies import FoundBodies, find_in_clip
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import mask_networks
from pipeline.errors import ParamsError, VideoError

RED, BLUE = (230, 60, 40), (40, 70, 240)
#: Paths of two discs that move and of one that rests, px; the clip begins 2 s after its video.
FIRST, SECOND, RESTING = drawn_clips.line((30, 40), (200, 50)), drawn_clips.line((200, 120), (40, 110)), (120.0, 80.0)
RADIUS, START = 11, 2.0


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    rng = np.random.default_rng(5)
    still = drawn_clips.with_disc(drawn_clips.still(rng), np.tile(RESTING, (30, 1)), RADIUS, (30, 200, 60))
    moving = drawn_clips.with_disc(drawn_clips.with_disc(still, FIRST, RADIUS, RED), SECOND, RADIUS, BLUE)
    return drawn_clips.recorded(rng, moving)


def found(frames: np.ndarray, **prompts: object) -> FoundBodies:
    return find_in_clip(drawn_clips.clip(frames, START), mask_networks(), Prompts.of(**prompts))  # type: ignore[arg-type]


def disc(path: np.ndarray) -> np.ndarray:
    """(T, H, W) bool of a disc."""
    y, x = np.mgrid[: drawn_clips.HEIGHT, : drawn_clips.WIDTH]
    return np.stack([np.hypot(x + 0.5 - cx, y + 0.5 - cy) < RADIUS for cx, cy in np.broadcast_to(path, (30, 2))])


def best_iou(masks: np.ndarray, true: np.ndarray) -> float:
    """The video IoU of the body that fits best."""
    ids = range(1, int(masks.max()) + 1)
    return max(((masks == k) & true).sum() / ((masks == k) | true).sum() for k in ids)


def test_the_moving_bodies_are_found_without_prompts(frames: np.ndarray) -> None:
    seen = found(frames)
    assert len(seen.bodies) == seen.masks.max() == 2
    assert min(best_iou(seen.masks, disc(FIRST)), best_iou(seen.masks, disc(SECOND))) > 0.8
    assert [b.origin for b in seen.bodies] == ["network"] * 2
    assert seen.notes == ()


def test_a_body_that_is_ignored_is_left_out_and_one_that_is_asked_for_is_kept(frames: np.ndarray) -> None:
    left = found(frames, ignore=[(*FIRST[15], START + 0.5)])
    assert len(left.bodies) == 1
    assert best_iou(left.masks, disc(SECOND)) > 0.8
    kept = found(frames, points=[tuple(FIRST[0])], objects=1)
    assert len(kept.bodies) == 1
    assert best_iou(kept.masks, disc(FIRST)) > 0.8
    nothing = found(frames, ignore=[(5, 5)])
    assert len(nothing.bodies) == 2
    assert "nothing was found there" in nothing.notes[0]


@pytest.mark.parametrize("prompt", ["points", "boxes"])
def test_a_body_that_rests_is_grown_where_the_user_points(frames: np.ndarray, prompt: str) -> None:
    x, y = RESTING
    at = (x, y) if prompt == "points" else (x - 12, y - 12, x + 12, y + 12)
    seen = found(frames, **{prompt: [at]})
    assert len(seen.bodies) == 3
    assert best_iou(seen.masks, disc(np.array(RESTING))) > 0.6
    assert any("followed through" in note or "only; it is kept" in note for note in seen.notes)


def test_a_box_around_a_body_that_moves_is_that_body(frames: np.ndarray) -> None:
    x, y = SECOND[10]
    seen = found(frames, boxes=[(x - 11, y - 11, x + 11, y + 11, START + 10 / 30)], objects=1)
    assert [b.origin for b in seen.bodies] == ["network"]
    assert best_iou(seen.masks, disc(SECOND)) > 0.8


@pytest.mark.parametrize(
    ("prompts", "message"),
    [
        (
            {"points": [(240, 20)]},
            r"--point 240,20: it is outside of the picture; valid: x from 0 to 239, y from 0 to 159",
        ),
        ({"points": [(20, 20, 1.0)]}, r"1 s is outside of the clip; valid: 2\.00 to 2\.97 s"),
        ({"ignore": [(20, 20, 9.0)]}, r"--ignore 20,20,9: 9 s is outside of the clip"),
        ({"boxes": [(250, 10, 300, 40)]}, r"--box 250,10,300,40: it is outside of the picture"),
        ({"boxes": [(10, 10, 10, 40)]}, r"it is empty"),
        ({"points": [(1, 2, 3, 4)]}, r"point 1,2,3,4: valid: x,y or x,y,t"),
        ({"points": [(1, float("nan"))]}, r"finite"),
        ({"objects": 0}, r"objects: 0; valid: 1 or more"),
        ({"objects": 40}, r"--objects 40: only \d+ moving things are found"),
        (
            {"points": [tuple(FIRST[0])], "ignore": [tuple(FIRST[0])]},
            r"names the body that is there; valid: one of the two",
        ),
    ],
)
def test_prompts_that_cannot_be_met_are_one_error(frames: np.ndarray, prompts: dict[str, object], message: str) -> None:
    with pytest.raises(ParamsError, match=message):
        found(frames, **prompts)


def test_where_all_bodies_are_ignored_none_is_left(frames: np.ndarray) -> None:
    with pytest.raises(VideoError, match="no body is left"):
        found(frames, ignore=[tuple(FIRST[0]), tuple(SECOND[0])])
