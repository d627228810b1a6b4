"""Laws of the noise on exact flow."""

import cv2
import numpy as np
import pytest

from pipeline.vision.flow.flow_noise import (
    CELL_PX,
    RAFT_RANGES,
    FlowNoise,
    nearest_foreground,
    noisy_flow,
    raft_noise,
    smooth_noise,
)


def moving_discs(rng, count=12, height=160, width=240):
    """Exact flow (T, H, W, 2) and masks (T, H, W) of two discs that move differently."""
    y, x = np.mgrid[:height, :width]
    flow, masks = np.zeros((count, height, width, 2), np.float32), np.zeros((count, height, width), np.uint8)
    for t in range(count):
        for i in (1, 2):
            cx, cy = rng.uniform(40, 200), rng.uniform(40, 120)
            disc = np.hypot(x - cx, y - cy) < rng.uniform(15, 30)
            masks[t][disc] = i
            angle = rng.uniform(0, 2 * np.pi)
            flow[t][disc] = rng.uniform(3, 9) * np.array([np.cos(angle), np.sin(angle)])
    return flow, masks


def test_without_noise_the_flow_is_exact(rng):
    flow, masks = moving_discs(rng, 3)
    assert np.array_equal(noisy_flow(rng, flow, masks, FlowNoise()), flow)


def test_the_same_generator_gives_the_same_noise_and_another_another():
    flow, masks = moving_discs(np.random.default_rng(0), 3)
    first, again, other = (noisy_flow(r, flow, masks, raft_noise(r)) for r in map(np.random.default_rng, (1, 1, 2)))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_drop_outs_have_their_share_and_lie_in_objects(rng):
    flow, masks = moving_discs(rng)
    noisy = noisy_flow(rng, flow, masks, FlowNoise(dropout=0.2, dropout_px=6))
    lost = (noisy != flow).any(-1)
    assert lost[masks > 0].mean() == pytest.approx(0.2, abs=0.02)
    assert not lost[masks == 0].any()
    assert (noisy[lost] == 0).all()


def test_leaks_lie_beside_objects_and_take_their_motion(rng):
    flow, masks = moving_discs(rng)
    noisy = noisy_flow(rng, flow, masks, FlowNoise(leak=0.4))
    for t in range(len(flow)):
        nearest = nearest_foreground(masks[t] > 0, 3.0)
        near = nearest >= 0
        leaked = (noisy[t] != flow[t]).any(-1)
        assert not (leaked & ~near).any()
        assert leaked.sum() == pytest.approx(0.4 * near.sum(), rel=0.1)
        assert np.array_equal(noisy[t][leaked], flow[t].reshape(-1, 2)[nearest[leaked]])


def test_the_nearest_foreground_is_the_nearest(rng):
    foreground = rng.random((40, 50)) < 0.05
    nearest = nearest_foreground(foreground, 4.5)
    places = np.argwhere(foreground)
    for y, x in np.ndindex(foreground.shape):
        away = np.hypot(*(places - (y, x)).T)
        if foreground[y, x] or away.min(initial=np.inf) > 4.5:
            assert nearest[y, x] == -1
        else:
            row, column = divmod(nearest[y, x], 50)
            assert foreground[row, column]
            assert np.hypot(row - y, column - x) == away.min()


def test_smooth_noise_keeps_its_deviation(rng):
    for sigma in (0.0, 1.0, 4.0):
        assert smooth_noise(rng, (300, 300), sigma).std() == pytest.approx(1, abs=0.15)


def test_the_flow_outside_is_still(rng):
    flow, masks = moving_discs(rng, 4)
    noisy = noisy_flow(rng, flow, masks, FlowNoise(still_px=0.05))
    far = np.stack([cv2.dilate(m, np.ones((25, 25), np.uint8)) == 0 for m in (masks > 0).astype(np.uint8)])
    assert noisy[far].std() == pytest.approx(0.05 / 2, rel=0.25)  # 240 px wide: half of 480


def test_drawn_noise_is_within_its_ranges(rng):
    for noise in (raft_noise(rng) for _ in range(12)):
        assert all(low <= getattr(noise, name) <= high for name, (low, high) in RAFT_RANGES.items())


def test_shadows_move_as_their_objects_do_and_hide_none(rng):
    flow, masks = moving_discs(rng, 6)
    noisy = noisy_flow(rng, flow, masks, FlowNoise(shadow=0.5))
    assert np.array_equal(noisy[masks > 0], flow[masks > 0])
    cast = noisy[masks == 0]
    assert 0 < (cast != 0).any(-1).mean() < 0.5
    assert np.linalg.norm(cast, axis=-1).max() <= 0.5 * np.linalg.norm(flow, axis=-1).max() + 1e-5


def test_the_ground_flickers_in_cells_and_blotches_that_reach_as_far_as_rafts(rng):
    flow = np.zeros((40, 160, 240, 2), np.float32)
    noise = FlowNoise(still_px=1.0, cell_px=CELL_PX)
    noisy = noisy_flow(rng, flow, np.zeros(flow.shape[:3], np.uint8), noise)
    assert noisy.std() == pytest.approx(0.5, rel=0.2)
    for lag, correlation in ((4, 0.87), (8, 0.67), (16, 0.46), (32, 0.24), (64, 0.08)):  # px of 240
        assert (noisy[:, :, lag:] * noisy[:, :, :-lag]).mean() / noisy.var() == pytest.approx(correlation, abs=0.1)


def test_negative_parameters_are_refused():
    with pytest.raises(ValueError, match="edge_px"):
        FlowNoise(edge_px=-1)
