"""The training of RAFT: pairs, augmentation, losses, optimiser, schedule."""

import itertools
import math

import cv2
import numpy as np
import pytest
import torch

from pipeline.vision.flow.raft import RAFT
from pipeline.vision.flow.raft_layers import Correlation
from pipeline.vision.rendering.camera import focal_px
from training.augment import augment
from training.body_motion import sample_body_motion
from training.checkpoint import load_checkpoint
from training.muon import Muon, orthogonalised
from training.raft.matching_loss import matching_loss
from training.raft.pair_stream import Phase, phase_at
from training.raft.rendered_pairs import aimed, render_pair, sample_pair_appearance, window_pair
from training.raft.trainer import Progress, make_optimisers, one_cycle, save_training, stays_inside
from training.raft.warped_pairs import warped_pair


def test_a_pair_of_one_generator_state_is_always_the_same():
    pairs = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        motion = sample_body_motion(rng)
        pairs.append(render_pair(rng, motion, sample_pair_appearance(rng, len(motion.objects)), 96, 64))
    assert np.array_equal(pairs[0].frame_b, pairs[1].frame_b)
    assert np.array_equal(pairs[0].flow_px, pairs[1].flow_px)


def test_bodies_that_rest_look_the_same_in_both_frames_and_have_no_flow(rng):
    motion = sample_body_motion(rng)
    still = type(motion)(
        motion.objects, np.repeat(motion.positions[:1], 2, 0), np.repeat(motion.quaternions[:1], 2, 0), motion.camera
    )
    pair = render_pair(rng, still, sample_pair_appearance(rng, len(motion.objects)), 96, 64)
    assert np.array_equal(pair.frame_a, pair.frame_b)
    assert np.abs(pair.flow_px).max() < 1e-3
    assert not pair.foreground.any()


def test_a_mirrored_pair_moves_the_other_way(rng):
    motion = sample_body_motion(rng)
    pair = window_pair(rng, motion, 96, 64, 160, False)
    twice = pair.mirrored().mirrored()
    assert np.array_equal(twice.flow_px, pair.flow_px)
    assert np.array_equal(pair.mirrored().flow_px[:, 0, 0], -pair.flow_px[:, -1, 0])
    assert np.array_equal(pair.mirrored().frame_a[:, 0], pair.frame_a[:, -1])


def test_the_second_frame_of_a_warped_pair_pulled_back_along_the_flow_is_the_first(rng):
    errors = []
    for _ in range(24):
        pair = warped_pair(rng, 96, 64)
        y, x = np.mgrid[:64, :96].astype(np.float32)
        at = np.stack([x, y], axis=-1) + pair.flow_px
        back = cv2.remap(pair.frame_b, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
        inside = (at[..., 0] > 1) & (at[..., 0] < 94) & (at[..., 1] > 1) & (at[..., 1] < 62)
        errors.append(np.abs(back.astype(int) - pair.frame_a).max(-1)[inside])
        assert pair.foreground.all()
    assert np.mean(np.concatenate(errors) <= 3) > 0.8  # the others are hidden in the second frame, or on an edge


def test_augmentation_leaves_the_flow_alone_but_for_mirroring(rng):
    pair = window_pair(rng, sample_body_motion(rng), 96, 64, 160, False)
    for _ in range(8):
        seen = augment(rng, pair)
        assert seen.frame_a.dtype == np.uint8
        assert any(np.array_equal(seen.flow_px, p.flow_px) for p in (pair, pair.mirrored()))


def test_a_windows_px_spans_the_angle_of_the_pictures_px(rng):
    motion = sample_body_motion(rng)
    window = aimed(rng, motion, 64 / 160)
    assert focal_px(window.camera.fov_y_deg, 64) == pytest.approx(focal_px(motion.camera.fov_y_deg, 160))
    assert np.allclose(window.camera.rotation_world.T @ window.camera.rotation_world, np.eye(3))
    assert np.linalg.det(window.camera.rotation_world) == pytest.approx(1)


def test_features_that_match_where_the_flow_leads_have_the_least_matching_loss(rng):
    """One feature a cell, all orthogonal; b is a, shifted by one cell."""
    h, w = 8, 9
    a = 40 * torch.eye(h * w).view(1, h * w, h, w)
    b = torch.roll(a, 1, dims=3)
    flow, foreground = torch.zeros(1, 2, 8 * h, 8 * w), torch.zeros(1, 8 * h, 8 * w, dtype=torch.bool)
    foreground[:, :, : 8 * (w - 1)] = True
    flow[:, 0] = 8
    right = float(matching_loss(Correlation(a, b, 3), flow, foreground))
    wrong = float(matching_loss(Correlation(a, a, 3), flow, foreground))
    assert right < 0.01 < 1 < wrong


def test_newton_schulz_makes_all_singular_values_close_to_one(rng):
    matrix = torch.from_numpy(rng.normal(size=(24, 60)).astype(np.float32))
    singular = torch.linalg.svdvals(orthogonalised(matrix))
    assert 0.6 < singular.min() <= singular.max() < 1.3
    u, _, vt = torch.linalg.svd(matrix, full_matrices=False)
    assert torch.nn.functional.cosine_similarity((u @ vt).flatten(), orthogonalised(matrix).flatten(), dim=0) > 0.97


def test_muon_minimises_a_quadratic(rng):
    target = torch.from_numpy(rng.normal(size=(16, 12, 3, 3)).astype(np.float32))
    weight = torch.nn.Parameter(torch.zeros_like(target))
    optimiser = Muon([weight], lr=0.05)
    for _ in range(300):
        optimiser.zero_grad()
        ((weight - target) ** 2).sum().backward()
        optimiser.step()
    assert float(((weight.detach() - target) ** 2).mean()) < 0.05 * float((target**2).mean())


def test_every_parameter_has_one_optimiser():
    model = RAFT("small", convex_upsampling=True)
    held = [id(p) for o in make_optimisers(model, 1e-3, 1e-3) for g in o.param_groups for p in g["params"]]
    assert sorted(held) == sorted(id(p) for p in model.parameters())


def test_the_rate_rises_falls_and_ends_near_zero():
    rates = [one_cycle(x) for x in np.linspace(0, 1, 200)]
    top = int(np.argmax(rates))
    assert rates[0] < 0.05
    assert rates[top] == pytest.approx(1, abs=0.01)
    assert all(a >= b for a, b in itertools.pairwise(rates[top:]))
    assert rates[-1] < 0.005


def test_the_phase_is_the_last_that_has_started():
    phases = (Phase(0.0, (64, 64), 8, 2), Phase(0.5, (96, 64), 8, 3))
    assert [phase_at(phases, x) for x in (0, 0.49, 0.5, 1)] == [phases[0], phases[0], phases[1], phases[1]]


def test_pixels_that_leave_the_window_carry_no_loss():
    flow = torch.zeros(1, 2, 64, 64)
    flow[:, 0, :, 60:] = 10
    inside = stays_inside(flow)
    assert inside[..., :60].all()
    assert not inside[..., 60:].any()


def test_a_checkpoint_is_whole_or_not_there(tmp_path):
    model = RAFT("small", convex_upsampling=True)
    file = tmp_path / "checkpoint.safetensors"
    save_training(file, model, make_optimisers(model, 1e-3, 1e-3), Progress(1.0, 2, 3))
    assert [p.name for p in tmp_path.iterdir()] == [file.name]
    state = load_checkpoint(file)
    assert state["progress"] == {"seconds": 1.0, "steps": 2, "pairs": 3}
    assert math.isclose(float(state["model"]["fnet.conv1.bias"][0]), float(model.fnet.conv1.bias[0]))
