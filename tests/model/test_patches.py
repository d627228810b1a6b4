from dataclasses import replace

import numpy as np
import pytest
import torch
from transformers import Qwen2VLImageProcessorPil

from pipeline.model.patches import PatchLayout, pack_video, resize_frames


@pytest.mark.parametrize(("patch", "merge", "width", "height"), [(14, 2, 84, 56), (16, 2, 64, 96), (14, 1, 28, 42)])
def test_pairs_of_equal_frames_are_packed_as_the_official_processor_packs_pictures(
    rng: np.random.Generator, patch: int, merge: int, width: int, height: int
) -> None:
    layout = PatchLayout(width, height, 4, patch=patch, merge=merge)
    pictures = rng.integers(0, 256, (2, height, width, 3), dtype=np.uint8)
    official = Qwen2VLImageProcessorPil(patch_size=patch, temporal_patch_size=2, merge_size=merge, do_resize=False)
    expected = official(list(pictures), return_tensors="np")
    own = pack_video(torch.as_tensor(pictures.repeat(2, axis=0)[None]), layout)
    np.testing.assert_allclose(own.numpy(), np.asarray(expected["pixel_values"]), atol=2e-5)
    np.testing.assert_array_equal(expected["image_grid_thw"][0][1:], layout.grid[1:])
    assert layout.tokens == len(own) // merge**2


def test_a_batch_is_packed_clip_by_clip(rng: np.random.Generator) -> None:
    layout = PatchLayout(56, 28, 4, 14)
    clips = torch.as_tensor(rng.integers(0, 256, (3, 4, 28, 56, 3), dtype=np.uint8))
    together = pack_video(clips, layout)
    for part, clip in zip(together.chunk(3), clips, strict=True):
        torch.testing.assert_close(part, pack_video(clip[None], layout))


def test_a_patch_holds_its_two_frames_in_order() -> None:
    layout = PatchLayout(28, 28, 2, 14, mean=(0, 0, 0), std=(1, 1, 1))
    frames = torch.zeros(1, 2, 28, 28, 3, dtype=torch.uint8)
    frames[0, 1] = 255
    patches = pack_video(frames, layout).reshape(4, 3, 2, 14, 14)
    assert (patches[:, :, 0] == 0).all()
    torch.testing.assert_close(patches[:, :, 1], torch.ones(4, 3, 14, 14))


def test_frames_are_resized_only_where_their_size_differs(rng: np.random.Generator) -> None:
    frames = rng.integers(0, 256, (2, 20, 30, 3), dtype=np.uint8)
    assert resize_frames(frames, 30, 20) is frames
    even = np.full((2, 20, 30, 3), 77, np.uint8)
    for width, height in ((15, 10), (60, 40)):
        np.testing.assert_array_equal(resize_frames(even, width, height), 77)
    assert resize_frames(frames, 15, 10).mean() == pytest.approx(frames.mean(), abs=1)


@pytest.mark.parametrize("size", [(100, 56, 4), (84, 50, 4), (84, 56, 3)])
def test_a_layout_that_does_not_divide_is_refused(size: tuple[int, int, int]) -> None:
    with pytest.raises(AssertionError):
        PatchLayout(*size, patch=14)


def test_the_third_channel_tells_a_patch_its_column_row_and_time(rng: np.random.Generator) -> None:
    layout = PatchLayout(12 * 3, 12 * 2, 4, patch=12, merge=1, mean=(0, 0, 0), std=(1, 1, 1), places=0.5)
    clips = torch.as_tensor(rng.integers(0, 256, (2, 4, 24, 36, 3), dtype=np.uint8))
    plain = pack_video(clips, replace(layout, places=0.0)).reshape(2, 2, 2, 3, 3, 2, 12, 12)
    told = pack_video(clips, layout).reshape(2, 2, 2, 3, 3, 2, 12, 12)  # B, t, h, w, channel, frame, row, column
    torch.testing.assert_close(told[..., :2, :, :, :], plain[..., :2, :, :, :])
    third = told[:, :, :, :, 2]
    for t, row, column in np.ndindex(2, 2, 3):
        for stripe, value in enumerate(((column - 1) * 2 / 3, row - 0.5, t - 0.5)):
            assert torch.allclose(third[:, t, row, column, ..., 4 * stripe : 4 * stripe + 4], torch.tensor(0.5 * value))
