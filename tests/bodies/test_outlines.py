"""Sharp outlines: squares around bodies, and what the network for outlines makes of masks."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from pipeline.bodies.networks.outline_network import (
    INPUTS,
    SIDE,
    OutlineNetwork,
    load_outline_network,
    save_outline_network,
)
from pipeline.bodies.networks.outlines import Square, sharpen, square_around
from pipeline.errors import ModelError

SHIPPED = Path(__file__).resolve().parents[2] / "models" / "masks"
MASK_CHANNEL = INPUTS - 2


class Echo(OutlineNetwork):
    """Says that the body is where the mask that it is shown has it."""

    def forward(self, squares: torch.Tensor) -> torch.Tensor:
        return 20 * (squares[:, MASK_CHANNEL] - 0.5)


def iou(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


def disc(shape: tuple[int, int], x: float, y: float, radius: float) -> np.ndarray:
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    return np.asarray((columns - x) ** 2 + (rows - y) ** 2 <= radius**2)


def rolling_disc(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Frames (8, 120, 160, 3) uint8 of a plain disc before a mottled wall, and its masks."""
    wall = cv2.resize(rng.uniform(60, 120, (12, 16, 3)).astype(np.float32), (160, 120), interpolation=cv2.INTER_CUBIC)
    masks = np.stack([disc((120, 160), 30 + 12 * t, 60 + 2 * t, 17) for t in range(8)])
    frames = np.stack([wall] * 8)
    frames[masks] = rng.uniform(150, 250, 3)
    frames += rng.normal(0, 2, frames.shape)
    return np.clip(frames, 0, 255).astype(np.uint8), masks


@given(left=st.integers(-40, 90), top=st.integers(-40, 60), side=st.integers(12, 100))
def test_what_is_cut_can_be_pasted_where_it_was(left: int, top: int, side: int) -> None:
    square, shape = Square(left, top, side), (80, 120)
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    picture = rows + 0.5 * columns
    back, window = square.paste(square.cut(picture), shape)
    inside = picture[window]
    assert back.shape == inside.shape
    kept = np.zeros(shape, bool)
    kept[5:-5, 5:-5] = True  # beyond the border the picture is level
    away = np.zeros((side, side), bool)
    away[3:-3, 3:-3] = True
    own = np.zeros(shape, bool)
    own[window] = away[window[0].start - top : window[0].stop - top, window[1].start - left : window[1].stop - left]
    middle = (kept & own)[window]
    np.testing.assert_allclose(back[middle], inside[middle], atol=1.0)


@given(x=st.integers(0, 119), y=st.integers(0, 79), radius=st.integers(0, 40))
def test_a_square_holds_the_whole_body(x: int, y: int, radius: int) -> None:
    mask = disc((80, 120), x, y, radius)
    square = square_around(mask)
    rows, columns = np.nonzero(mask)
    assert square.left < columns.min() and columns.max() < square.left + square.side
    assert square.top < rows.min() and rows.max() < square.top + square.side


def test_masks_that_the_network_agrees_with_stay() -> None:
    frames, true = rolling_disc(np.random.default_rng(0))
    masks = true.astype(np.uint8) * 3
    found = sharpen(frames, masks, Echo().eval())
    assert set(np.unique(found)) == {0, 3}
    for one, other in zip(found > 0, true, strict=True):
        assert iou(one, other) > 0.93


def test_frames_without_a_body_stay_without_one() -> None:
    frames, true = rolling_disc(np.random.default_rng(1))
    masks = true.astype(np.uint8)
    masks[3:] = 0
    found = sharpen(frames, masks, load_outline_network(SHIPPED))
    assert found[:3].any() and not found[3:].any()
    assert not sharpen(frames, np.zeros_like(masks), load_outline_network(SHIPPED)).any()


@pytest.mark.parametrize("size", [-4, 4])
def test_an_outline_that_is_too_small_or_too_large_comes_nearer(size: int) -> None:
    frames, true = rolling_disc(np.random.default_rng(2))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * abs(size) + 1,) * 2)
    change = cv2.dilate if size > 0 else cv2.erode
    masks = np.stack([change(m.astype(np.uint8), kernel) for m in true])
    found = sharpen(frames, masks, load_outline_network(SHIPPED))
    before = np.mean([iou(m > 0, t) for m, t in zip(masks, true, strict=True)])
    after = np.mean([iou(m > 0, t) for m, t in zip(found, true, strict=True)])
    assert before < 0.7 and after > 0.9


def test_weights_are_read_as_they_were_written(tmp_path: Path) -> None:
    torch.manual_seed(0)
    network = OutlineNetwork((8, 8, 12, 16)).eval()
    save_outline_network(network, tmp_path, {"steps": 1})
    squares = torch.rand(2, INPUTS, SIDE, SIDE)
    with torch.inference_mode():
        torch.testing.assert_close(load_outline_network(tmp_path)(squares), network(squares), atol=0.02, rtol=0.02)
    (tmp_path / "outlines.json").write_text('{"channels": [8, 8, 12, 20]}')
    with pytest.raises(ModelError, match="does not hold"):
        load_outline_network(tmp_path)


def test_a_folder_without_weights_for_outlines_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"outlines\.safetensors"):
        load_outline_network(tmp_path)
