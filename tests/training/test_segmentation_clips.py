"""Laws of the clips that the segmentation network is trained on."""

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
import torch

from pipeline.bodies.networks.inputs import network_input
from pipeline.bodies.networks.network import VOTE_SCALE_PX, SegmentationNetwork
from training.segmentation.backgrounds import PICTURES, sample_background
from training.segmentation.clip import BODY_SHADOW, MOVES, RESTS, UNSURE, TrainingClip, faint, state_of
from training.segmentation.flat_motion import STEPS_PER_SECOND, integrate, sample_motion
from training.segmentation.generate import make_clip
from training.segmentation.kept_arrays import load_arrays, save_arrays
from training.segmentation.loss import PARTS, segmentation_loss
from training.segmentation.recording import exposure, letterboxed, recorded
from training.segmentation.samples import batched, draw_sample, with_clear_plate
from training.segmentation.shadows import label_shadows
from training.segmentation.sprites import placed, sample_sprite
from training.segmentation.train import LISTED_EVERY, Clips, learning_rate


@pytest.fixture(scope="module")
def clip():
    return make_clip(5, 3, "flat")


def test_a_clip_is_the_same_when_it_is_made_again_from_its_seed_and_index(clip):
    again = make_clip(5, 3, "flat")
    for f in fields(clip):
        np.testing.assert_array_equal(getattr(clip, f.name), getattr(again, f.name), err_msg=f.name)


def test_a_saved_clip_is_read_as_it_was(clip, tmp_path):
    save_arrays(tmp_path / "000003.npz", clip)
    again = load_arrays(tmp_path / "000003.npz", TrainingClip)
    for f in fields(clip):
        np.testing.assert_array_equal(getattr(clip, f.name), getattr(again, f.name))
    assert [p.name for p in tmp_path.iterdir()] == ["000003.npz"]


def test_a_clip_has_a_body_that_moves_and_no_pixel_is_a_body_and_another_thing(clip):
    count, bodies = clip.centre.shape[:2]
    assert len(clip.frames) == len(clip.mask) == count and clip.mask.max() <= bodies
    assert (clip.state == MOVES).any()
    assert not ((clip.mask > 0) & clip.other).any()


def test_a_ray_cast_clip_has_masks_inside_its_bodies_radii():
    clip = make_clip(5, 4, "raycast")
    rows, cols = np.mgrid[: clip.mask.shape[1], : clip.mask.shape[2]] + 0.5
    for t in (0, len(clip.mask) - 1):
        for i in np.unique(clip.mask[t])[1:]:
            away = np.hypot(cols - clip.centre[t, i - 1, 0], rows - clip.centre[t, i - 1, 1])[clip.mask[t] == i]
            assert away.min() < 3 * clip.radius[t, i - 1] + 2


def test_shadows_are_labelled_beside_bodies_and_where_it_is_darker_than_in_the_empty_scene():
    empty = np.full((20, 30, 3), 120, np.float32)
    frames = np.stack([empty] * 2)
    frames[1, 5:10, 5:15] *= 0.6  # a shadow
    frames[1, 5:10, 12:20] = 30  # a body, over a part of it
    frames[1, 0:3, 0:3] *= 1.3  # a reflection
    mask = np.zeros((2, 20, 30), np.uint8)
    mask[1, 5:10, 12:20] = 1
    labels = label_shadows(frames, empty, mask)
    assert not labels[0].any()
    assert (labels[1, 5:10, 5:12] == BODY_SHADOW).all() and np.count_nonzero(labels[1]) == 35


def test_a_clip_of_the_own_sampler_has_bodies_that_move_and_labelled_shadows():
    clip = make_clip(5, 1, "sampled")
    assert (clip.state == MOVES).any() and (clip.mask > 0).any()
    assert not ((clip.mask > 0) & (clip.other > 0)).any()


def test_a_clear_plate_is_nearer_to_the_empty_scene_than_the_median(clip):
    """Where the found bodies leave a pixel for a while it shows what is behind; elsewhere the median stays."""
    with_plate = with_clear_plate(np.random.default_rng(0), clip)
    for f in fields(clip):
        if f.name != "background":
            np.testing.assert_array_equal(getattr(clip, f.name), getattr(with_plate, f.name))
    never = ~(clip.mask > 0).any(0)
    far = cv2.erode(never.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    far &= ~(clip.other > 0).any(0)
    np.testing.assert_array_equal(clip.background[far], with_plate.background[far])


def test_clips_that_are_added_while_training_runs_are_loaded_next(clip, tmp_path):
    for index in range(3):
        save_arrays(tmp_path / f"{index:06d}.npz", clip)
    clips = Clips(tmp_path, np.random.default_rng(0))
    clips.renew(2)
    assert len(clips.paths) == 3
    added = replace(clip, background=np.zeros_like(clip.background))
    save_arrays(tmp_path / "000009.npz", added)
    clips.renew(LISTED_EVERY)
    assert len(clips.paths) == 4 and any(p.name == "000009.npz" for p in clips.paths)


def test_states_follow_the_thresholds():
    np.testing.assert_array_equal(
        state_of(np.array([3.0, 0, 1, 0]), np.array([0.0, 20, 0, 0])), [MOVES, MOVES, UNSURE, RESTS]
    )


def test_a_body_of_its_surroundings_colour_is_faint():
    frames = np.full((4, 40, 40, 3), 100, np.uint8)
    mask = np.zeros((4, 40, 40), np.uint8)
    mask[:, 5:15, 5:15], mask[:, 25:35, 25:35] = 1, 2
    frames[mask == 2] = 130
    np.testing.assert_array_equal(faint(frames, mask, 2), [True, False])


@pytest.mark.parametrize("kind", list(PICTURES), ids=lambda k: k.__name__)
def test_each_kind_of_background_is_a_finite_picture(kind):
    picture = kind(np.random.default_rng(0), 60, 40)
    assert picture.shape == (40, 60, 3) and np.isfinite(picture).all()


def test_backgrounds_are_in_range():
    for seed in range(10):
        picture = sample_background(np.random.default_rng(seed), 60, 40)
        assert picture.min() >= 0 and picture.max() <= 1


def fall(segments, position, velocity, rolls, seconds=0.5, gravity=9.81, bounce=0.0):
    steps = round(seconds * STEPS_PER_SECOND)
    positions, angles = np.empty((steps, 1, 2)), np.empty((steps, 1))
    start, speed, lines = (np.array(v, float) for v in ([position], [velocity], segments))
    integrate(
        start,
        speed,
        np.zeros(1),
        np.array([0.1]),
        np.array([rolls]),
        np.zeros(1),
        lines,
        gravity,
        0.0,
        bounce,
        1 / STEPS_PER_SECOND,
        positions,
        angles,
    )
    return positions[:, 0], angles[:, 0]


def test_a_thrown_body_follows_the_parabola():
    path, _ = fall([[[-9, 50], [9, 50]]], (0.0, 0.0), (1.0, -2.0), True)
    t = np.arange(len(path)) / STEPS_PER_SECOND
    np.testing.assert_allclose(path[:, 0], t, atol=1e-6)
    np.testing.assert_allclose(path[:, 1], -2 * t + 0.5 * 9.81 * t**2, atol=0.02)


def test_a_disc_rolls_without_slip_on_a_level_segment():
    path, angle = fall([[[-9, 0.1], [9, 0.1]]], (0.0, 0.0), (1.0, 0.0), True)
    np.testing.assert_allclose(path[:, 1], 0, atol=1e-3)
    np.testing.assert_allclose(angle[-1] - angle[10], (path[-1, 0] - path[10, 0]) / 0.1, rtol=0.02)


def test_a_body_accelerates_down_an_incline_by_g_sine():
    tilt = np.radians(30)
    along, normal = np.array([np.cos(tilt), np.sin(tilt)]), np.array([np.sin(tilt), -np.cos(tilt)])
    path, _ = fall([[-9 * along, 9 * along]], normal * 0.1001, (0.0, 0.0), False)
    assert np.linalg.norm(path[-1] - path[0]) == pytest.approx(0.5 * 9.81 * np.sin(tilt) * 0.5**2, rel=0.03)


def test_a_random_motion_is_finite():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        motion = sample_motion(rng, 1.5, rng.random(3) < 0.5, 0.5)
        assert np.isfinite(motion.position).all() and np.isfinite(motion.angle).all()


def test_a_sprite_is_drawn_about_its_centre():
    sprite = sample_sprite(np.random.default_rng(1), 24.0, np.zeros(3))
    disc = replace(
        sprite,
        alpha=(
            np.hypot(*(np.mgrid[: len(sprite.alpha), : len(sprite.alpha)] - len(sprite.alpha) / 2 + 0.5)) < 24
        ).astype(np.float32),
    )
    layer, (rows, cols) = placed(disc, np.array([40.0, 30.0]), 12.0, 0.7, 100, 80, (0.0, 0.0))
    inside = np.argwhere(layer[..., 3] > 0.5)
    centre = inside.mean(0) + np.array([rows.start + 0.5, cols.start + 0.5])
    np.testing.assert_allclose(centre, [30, 40], atol=0.3)
    assert len(inside) == pytest.approx(np.pi * 12**2, rel=0.06)
    assert placed(disc, np.array([-90.0, 30.0]), 12.0, 0.0, 100, 80, (0.0, 0.0)) is None


def test_recorded_frames_keep_their_shape_and_their_seed():
    frames = np.random.default_rng(0).uniform(0, 255, (8, 32, 48, 3)).astype(np.float32)
    one, two = (recorded(np.random.default_rng(9), frames.copy()) for _ in range(2))
    assert one.shape == frames.shape and one.dtype == np.uint8
    np.testing.assert_array_equal(one, two)


def test_exposure_is_positive():
    assert all((exposure(np.random.default_rng(s), 30, 20) > 0.3).all() for s in range(50))


def test_letterboxed_masks_are_empty_in_the_bars():
    frames, mask = np.full((3, 20, 40, 3), 80, np.uint8), np.ones((3, 20, 40), np.uint8)
    boxed, cut = letterboxed(np.random.default_rng(0), [frames, mask], 0.5)
    assert cut[:, :, :10].max() == 0 and cut[:, :, 30:].max() == 0 and cut[:, :, 10:30].min() == 1
    assert boxed.shape == frames.shape


def test_votes_of_a_sample_point_at_the_centre(clip):
    t = int(np.argmax((clip.mask > 0).sum((1, 2))))
    sample = draw_sample(np.random.default_rng(0), clip, t, None, augment=False)
    rows, cols = np.nonzero(sample.weight)
    ids = clip.mask[t][::2, ::2][rows, cols]
    np.testing.assert_allclose(
        cols * 2 + 0.5 + VOTE_SCALE_PX * sample.offset[0, rows, cols], clip.centre[t, ids - 1, 0], atol=0.01
    )
    np.testing.assert_allclose(
        rows * 2 + 0.5 + VOTE_SCALE_PX * sample.offset[1, rows, cols], clip.centre[t, ids - 1, 1], atol=0.01
    )


def test_a_mirrored_sample_has_mirrored_votes_and_flow(clip):
    plain = draw_sample(np.random.default_rng(0), clip, 2, (96, 64), augment=False)
    names = {f.name for f in fields(plain)}
    assert {"flow", "offset"} <= names
    for seed in range(20):
        sample = draw_sample(np.random.default_rng(seed), clip, 2, (96, 64), augment=True)
        assert sample.frame.shape == (3, 64, 96) and sample.flow.shape == (4, 32, 48)
        assert all(np.isfinite(getattr(sample, n)).all() for n in names)


def test_the_loss_is_finite_and_falls_when_one_batch_is_learnt(clip):
    torch.manual_seed(0)
    network = SegmentationNetwork((8, 8, 8, 8))
    rng = np.random.default_rng(0)
    batch = batched([draw_sample(rng, clip, t, (96, 64), augment=True) for t in range(4)])
    optimiser = torch.optim.AdamW(network.parameters(), 1e-2)
    losses = []
    for _ in range(15):
        loss, parts = segmentation_loss(network, batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss))
        assert len(parts) == len(PARTS) and torch.isfinite(parts).all()
    assert losses[-1] < 0.8 * losses[0]


def test_the_network_input_does_not_see_frames_that_look_alike():
    frame = torch.rand(1, 3, 16, 16)
    others = frame[:, None].expand(-1, 4, -1, -1, -1)
    full, half = network_input(frame, frame, frame, frame, torch.zeros(1, 1, 16, 16), others, torch.zeros(1, 4, 8, 8))
    assert full[:, 3:].abs().max() == 0 and half.abs().max() == 0


def test_the_learning_rate_rises_and_falls_to_nothing():
    assert learning_rate(0, 0.0) < learning_rate(200, 0.0) == 1.0
    assert learning_rate(10**6, 1.0) == pytest.approx(0, abs=1e-9)
