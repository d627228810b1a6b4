import numpy as np
from sampled_scenes import SCHEDULE, clips

from pipeline.clips.view import areas_px, frame_masks, pair_view, trace_pairs


def test_areas_count_the_pixels_of_each_object_at_480x320(rng: np.random.Generator) -> None:
    masks = rng.integers(0, 4, (5, 80, 120)).astype(np.uint8)
    areas = areas_px(masks, 3)
    for i in range(3):
        np.testing.assert_allclose(areas[:, i], 16 * (masks == i + 1).sum((1, 2)))


def test_pairs_show_the_frames_that_the_model_sees_and_flow_to_the_next(rng: np.random.Generator) -> None:
    (clip,) = clips(int(rng.integers(2**31)), 1, {2: 1.0})
    view = pair_view(clip.scene, *trace_pairs(clip.trace, SCHEDULE), 240, 160)
    np.testing.assert_array_equal(view.mask, clip.masks[SCHEDULE.pairs[:, 0]])
    assert view.flow.shape == (10, 160, 240, 2)
    assert (view.flow[view.mask == 0] == 0).all()
    assert np.isfinite(view.depth[view.mask > 0]).all()


def test_a_larger_picture_shows_the_same_areas(rng: np.random.Generator) -> None:
    (clip,) = clips(int(rng.integers(2**31)), 1, {1: 1.0})
    small = areas_px(clip.masks, 1)
    large = areas_px(frame_masks(clip.scene, clip.trace, SCHEDULE, 480, 320), 1)
    np.testing.assert_allclose(small, large, atol=60, rtol=0.03)
