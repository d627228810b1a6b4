"""Laws of the benchmark of masks."""

import json

import numpy as np
import pytest

from benchmarks.mask_clips import MaskClip, outlined
from benchmarks.masks import score
from pipeline.vision.recordings.video import write_video


def two_squares(moving=(1, 2)):
    masks = np.zeros((6, 40, 60), np.uint8)
    for t in range(6):
        masks[t, 5:15, 5 + 4 * t : 15 + 4 * t] = 1
        masks[t, 25:35, 40 - 4 * t : 50 - 4 * t] = 2
    return MaskClip(
        name="squares",
        frames=np.zeros((6, 40, 60, 3), np.uint8),
        times=np.arange(6) / 30,
        masks=masks,
        labelled=np.arange(6),
        moving=moving,
    )


def test_the_true_masks_score_1_whatever_their_ids():
    clip = two_squares()
    for ids in ([0, 1, 2], [0, 2, 1], [0, 7, 3]):
        iou, extra = score(np.array(ids, np.uint8)[clip.masks], clip)
        np.testing.assert_allclose(iou, 1)
        assert extra == 0


def test_a_body_that_is_not_found_scores_0_and_one_too_many_is_extra():
    clip = two_squares()
    one = np.where(clip.masks == 1, 1, 0).astype(np.uint8)
    iou, extra = score(one, clip)
    assert iou.tolist() == [1.0, 0.0] and extra == 0
    more = clip.masks.copy()
    more[:, 18:22, 50:56] = 3
    iou, extra = score(more, clip)
    assert iou.tolist() == [1.0, 1.0] and extra == 1
    assert score(np.zeros_like(clip.masks), clip)[1] == 0


def test_a_body_found_in_half_of_its_frames_scores_half():
    clip = two_squares((1,))
    half = np.where(clip.masks == 1, 1, 0).astype(np.uint8)
    half[3:] = 0
    assert score(half, clip)[0][0] == pytest.approx(0.5)


def test_a_resting_body_that_is_found_is_not_extra():
    clip = two_squares((1,))
    assert score(clip.masks, clip)[1] == 0


def test_ids_that_change_in_the_middle_of_the_clip_cost_half():
    clip = two_squares()
    swapped = clip.masks.copy()
    swapped[3:] = np.array([0, 2, 1], np.uint8)[clip.masks[3:]]
    np.testing.assert_allclose(score(swapped, clip)[0], 0.5)


def test_outlines_are_read_at_their_frames_and_size(tmp_path):
    videos, folder = tmp_path / "videos", tmp_path / "outlines"
    videos.mkdir(), folder.mkdir()
    write_video(videos / "clip.mp4", np.full((12, 64, 96, 3), 90, np.uint8))
    polygon = [[10, 20], [29, 20], [29, 39], [10, 39]]
    record = {
        "clip": "clip.mp4",
        "width": 96,
        "height": 64,
        "fps": 30,
        "file_fps": 30,
        "stretch_frames": [2, 10],
        "stretch_file_seconds": [2 / 30, 10 / 30],
        "objects": [{"name": "ball", "shape": "sphere"}],
        "frames": {"3": [{"object": "ball", "polygon": polygon}], "8": []},
        "static": {},
        "notes": "",
    }
    (folder / "clip.json").write_text(json.dumps(record))
    (clip,) = outlined(folder, videos)
    assert clip.frames.shape == (9, 64, 96, 3) and clip.labelled.tolist() == [1, 6] and clip.moving == (1,)
    assert (clip.masks[0] > 0).sum() == 400 and clip.masks[0][20:40, 10:30].all() and not clip.masks[1].any()
