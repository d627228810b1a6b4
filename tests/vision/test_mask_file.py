"""Laws of reading masks, and what bad files give."""

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import VideoError
from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.mask_file import read_masks

SIZE = (48, 32)


@pytest.fixture
def masks(rng):
    """(3, 32, 48) uint8 with the ids 0, 1, 2."""
    coarse = rng.integers(0, 3, (3, 4, 6))
    coarse[0, 0, :3] = 0, 1, 2
    return np.kron(coarse, np.ones((1, 8, 8))).astype(np.uint8)


def test_an_npz_is_read_as_it_is(tmp_path, masks):
    np.savez(tmp_path / "masks.npz", masks=masks)
    assert np.array_equal(read_masks(tmp_path / "masks.npz", SIZE), masks)


def test_a_folder_of_pngs_is_read_in_the_order_of_names(tmp_path, masks):
    for k, mask in enumerate(masks):
        Image.fromarray(mask).save(tmp_path / f"{k:05d}.png")
    assert np.array_equal(read_masks(tmp_path, SIZE), masks)


def test_grey_palette_colour_and_transparent_pngs_say_the_same(tmp_path, masks):
    mask = masks[0]
    colours = np.array([[0, 0, 0], [10, 0, 0], [10, 200, 0]], np.uint8)
    Image.fromarray(mask * 100).save(tmp_path / "grey.png")
    palette = Image.fromarray(mask)
    palette.putpalette(list(colours.ravel()) + [0] * (768 - 9))
    palette.save(tmp_path / "palette.png")
    Image.fromarray(colours[mask]).save(tmp_path / "colour.png")
    alpha = np.where(mask > 0, 255, 0)[..., None].astype(np.uint8)
    Image.fromarray(np.concatenate([colours[mask] | (255 - alpha), alpha], axis=-1)).save(tmp_path / "alpha.png")
    for name in ("grey", "palette", "colour", "alpha"):
        assert np.array_equal(read_masks(tmp_path / f"{name}.png", SIZE)[0], mask), name


def test_resizing_keeps_ids_whole(tmp_path, masks):
    np.savez(tmp_path / "masks.npz", masks=masks * 7)
    larger = read_masks(tmp_path / "masks.npz", (96, 64))
    assert larger.shape == (3, 64, 96)
    assert np.array_equal(larger[:, ::2, ::2], masks)


def test_masks_of_the_sources_size_are_placed_as_the_clip_is(tmp_path, rng):
    masks = rng.integers(0, 3, (2, 48, 64)).astype(np.uint8)
    np.savez(tmp_path / "masks.npz", masks=masks)
    letterbox = letterbox_for((64, 48), (84, 48))
    left, _, width, _ = letterbox.place
    read = read_masks(tmp_path / "masks.npz", (84, 48), letterbox=letterbox)
    assert np.array_equal(read[:, :, left : left + width], masks)
    assert not read[:, :, :left].any()


def error_of(path):
    with pytest.raises(VideoError) as caught:
        read_masks(path, SIZE)
    return str(caught.value)


def test_bad_mask_files_are_named(tmp_path, masks):
    assert "there are no masks there" in error_of(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    assert "has no PNG files" in error_of(tmp_path / "empty")
    (tmp_path / "text.png").write_text("text")
    assert "is not a PNG picture" in error_of(tmp_path / "text.png")
    (tmp_path / "text.npz").write_text("text")
    assert "is not an NPZ archive" in error_of(tmp_path / "text.npz")
    (tmp_path / "masks.txt").write_text("text")
    assert "is no mask file" in error_of(tmp_path / "masks.txt")
    np.savez(tmp_path / "other.npz", depth=masks)
    assert "no array `masks`" in error_of(tmp_path / "other.npz")
    np.savez(tmp_path / "float.npz", masks=masks.astype(float))
    assert "not integers" in error_of(tmp_path / "float.npz")
    np.savez(tmp_path / "nothing.npz", masks=0 * masks)
    assert "are empty" in error_of(tmp_path / "nothing.npz")
    np.savez(tmp_path / "picture.npz", masks=np.arange(32 * 48).reshape(1, 32, 48))
    assert "at most 255" in error_of(tmp_path / "picture.npz")
