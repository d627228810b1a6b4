"""Laws of masks from motion."""

import cv2
import numpy as np
import pytest

from benchmarks.motion_masks import masks_from_motion
from pipeline.errors import VideoError

HEIGHT, WIDTH, COUNT = 120, 180, 20


def clip_of_discs(rng, paths, radius=14):
    """Frames, exact flow (T - 1, H, W, 2) and masks of discs with centres paths (N, T, 2) px, nearer ones last."""
    floor = cv2.resize(rng.integers(60, 120, (15, 22, 3), np.uint8), (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    frames, masks = np.stack([floor] * COUNT), np.zeros((COUNT, HEIGHT, WIDTH), np.uint8)
    flow = np.zeros((COUNT - 1, HEIGHT, WIDTH, 2), np.float32)
    for i, path in enumerate(paths):
        colour = np.array([(230, 60, 40), (40, 220, 60), (60, 80, 240)][i])
        for t, (cx, cy) in enumerate(path):
            disc = np.hypot(x - cx, y - cy) < radius
            frames[t][disc] = colour
            masks[t][disc] = i + 1
            if t + 1 < COUNT:
                flow[t][disc] = path[t + 1] - path[t]
    noise = rng.normal(size=frames.shape) * 2
    return np.clip(frames + noise, 0, 255).astype(np.uint8), flow, masks


def line(start, end, count=COUNT):
    return np.linspace(start, end, count)


def iou(a, b):
    return (a & b).sum() / max((a | b).sum(), 1)


def test_a_body_that_moves_is_found_in_every_frame(rng):
    frames, flow, masks = clip_of_discs(rng, [line((30, 60), (140, 70))])
    found = masks_from_motion(frames, flow)
    assert found.max() == 1
    assert min(iou(found[t] == 1, masks[t] == 1) for t in range(COUNT)) > 0.8


def test_two_bodies_keep_their_ids(rng):
    frames, flow, masks = clip_of_discs(rng, [line((30, 30), (150, 30)), line((150, 90), (30, 90))])
    found = masks_from_motion(frames, flow)
    assert found.max() == 2
    for i in (1, 2):
        ids = {int(np.median(found[t][masks[t] == i])) for t in range(COUNT)}
        assert len(ids) == 1


def test_bodies_that_pass_before_each_other_keep_their_ids(rng):
    frames, flow, masks = clip_of_discs(rng, [line((30, 55), (150, 55)), line((150, 65), (30, 65))])
    found = masks_from_motion(frames, flow)
    first = [int(np.median(found[0][masks[0] == i])) for i in (1, 2)]
    last = [int(np.median(found[-1][masks[-1] == i])) for i in (1, 2)]
    assert first == last
    assert first[0] != first[1]


def test_a_body_that_comes_to_rest_leaves_no_ghost(rng):
    path = np.concatenate([line((30, 60), (120, 60), 7), np.repeat([[120.0, 60.0]], 13, axis=0)])
    frames, flow, masks = clip_of_discs(rng, [path])
    found = masks_from_motion(frames, flow)
    assert (found > 0)[masks == 0].mean() < 0.01
    assert min(iou(found[t] > 0, masks[t] > 0) for t in range(COUNT)) > 0.75


def test_a_clip_in_which_nothing_moves_is_an_error(rng):
    frames, flow, _ = clip_of_discs(rng, [np.repeat([[60.0, 60.0]], COUNT, axis=0)])
    with pytest.raises(VideoError, match="nothing moves"):
        masks_from_motion(frames, flow)


def test_flow_of_another_length_is_refused(rng):
    frames, flow, _ = clip_of_discs(rng, [line((30, 60), (140, 70))])
    with pytest.raises(ValueError, match="20 frames need 19 flows"):
        masks_from_motion(frames, flow[:-1])
