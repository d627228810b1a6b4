"""A replay's masks, depth, flow and areas."""

import numpy as np
import pytest
from sampled_scenes import SCHEDULE, clips

from pipeline.clips.replay import replay, replay_poses, replay_trace
from pipeline.clips.view import EVENT_SIZE, areas_px, event_areas, frame_masks, pair_view, trace_pairs


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


def test_a_replay_and_one_as_a_search_makes_it_show_the_same() -> None:
    for clip in clips(3, 4):  # of a fixed seed: the two differ by rounding, which contacts may amplify
        run, quick = replay(clip.scene, SCHEDULE, 120, 80), replay_poses(clip.scene, SCHEDULE, 120, 80)
        np.testing.assert_allclose(run.position, quick.position, atol=1e-6)
        np.testing.assert_array_equal(run.masks, quick.masks)
        with pytest.raises(AssertionError):
            _ = quick.events


def test_the_flow_of_the_models_frames_is_part_of_that_of_all_frames(rng: np.random.Generator) -> None:
    (clip,) = clips(int(rng.integers(2**31)), 1, {2: 1.0})
    run = replay_trace(clip.scene, clip.trace, SCHEDULE, 240, 160)
    np.testing.assert_array_equal(run.frame_flow[SCHEDULE.pairs[:, 0]], run.flow)
    view = pair_view(clip.scene, *trace_pairs(clip.trace, SCHEDULE), 240, 160)
    np.testing.assert_array_equal(run.flow, view.flow)
    np.testing.assert_array_equal(run.depth, view.depth)
    np.testing.assert_array_equal(run.masks, clip.masks)


def test_events_are_of_one_size_whatever_the_replays_is(rng: np.random.Generator) -> None:
    (clip,) = clips(int(rng.integers(2**31)), 1, {3: 1.0})
    small, large = (replay_trace(clip.scene, clip.trace, SCHEDULE, *size) for size in ((120, 80), (480, 320)))
    assert small.events == large.events
    masks = frame_masks(clip.scene, clip.trace, SCHEDULE, *EVENT_SIZE)
    np.testing.assert_array_equal(event_areas(clip.scene, clip.trace, SCHEDULE), areas_px(masks, 3))
