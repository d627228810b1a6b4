"""Laws of the segmentation network and its inputs."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.bodies.candidates import candidate_scores, draw_masks, find_candidates, working_size
from pipeline.bodies.networks import load_mask_networks
from pipeline.bodies.networks.inputs import FULL_CHANNELS, HALF_CHANNELS, clip_features, steady_exposure
from pipeline.bodies.networks.network import STRIDE, SegmentationNetwork, load_network, save_network, without_norms
from pipeline.bodies.tracks.track_score import FIGURES
from pipeline.errors import ModelError

SMALL = (8, 8, 8, 8)


def random_network(seed=0):
    torch.manual_seed(seed)
    return SegmentationNetwork(SMALL).eval()


def random_clip(rng, count=5, height=64, width=96):
    return rng.integers(0, 256, (count, height, width, 3), dtype=np.uint8)


def test_a_network_saved_and_loaded_answers_the_same_to_half_precision(tmp_path):
    network = random_network()
    save_network(network, tmp_path, {"note": "a test"})
    again = load_network(tmp_path)
    full, half = torch.randn(1, FULL_CHANNELS, 32, 48), torch.randn(1, HALF_CHANNELS, 16, 24)
    with torch.no_grad():
        for one, other in zip(network(full, half), again(full, half), strict=True):
            torch.testing.assert_close(one, other, rtol=2e-2, atol=2e-2)
    assert again.config["note"] == "a test"
    save_network(again, tmp_path / "twice", {})
    with torch.no_grad():
        for one, other in zip(again(full, half), load_network(tmp_path / "twice")(full, half), strict=True):
            torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_the_default_network_has_at_most_4_million_parameters():
    assert sum(p.numel() for p in SegmentationNetwork().parameters()) <= 4_000_000


def test_a_folder_without_weights_is_refused_by_name(tmp_path):
    with pytest.raises(ModelError, match=r"model\.safetensors"):
        load_network(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"not safetensors")
    (tmp_path / "config.json").write_text('{"channels": [8, 8, 8, 8]}')
    with pytest.raises(ModelError, match="does not hold"):
        load_network(tmp_path)


def test_weights_of_other_channels_are_refused(tmp_path):
    save_network(random_network(), tmp_path, {})
    config = tmp_path / "config.json"
    config.write_text(config.read_text().replace("8", "16"))
    with pytest.raises(ModelError):
        load_network(tmp_path)


@pytest.mark.parametrize("size", [(480, 320), (640, 480), (320, 240), (172, 1716), (1920, 1080), (37, 41)])
def test_the_working_size_keeps_the_shape_and_is_a_multiple_of_the_stride(size):
    width, height = working_size(*size)
    assert width % STRIDE == 0 and height % STRIDE == 0
    assert width * height <= 1.6 * 240 * 160
    if max(size) < 3 * min(size):
        assert abs(np.log(width / height * size[1] / size[0])) < 0.15


def test_steady_exposure_undoes_a_gain_of_single_frames():
    rng = np.random.default_rng(0)
    still = rng.integers(20, 200, (40, 60, 3)).astype(np.float32)
    gain = np.array([1, 1.2, 1, 0.85, 1])
    frames = np.clip((still[None] + 4) * gain[:, None, None, None] - 4 + 0.5, 0, 255).astype(np.uint8)
    steady = steady_exposure(frames).astype(int)
    assert np.abs(steady - still.astype(int)).max() <= 3
    np.testing.assert_array_equal(steady_exposure(np.stack([frames[0]] * 3)), np.stack([frames[0]] * 3))


def test_features_of_a_still_clip_are_the_picture_itself():
    picture = random_clip(np.random.default_rng(1), 1)[0]
    features = clip_features(np.stack([picture] * 4))
    for found in (features.background, features.low, features.high):
        np.testing.assert_array_equal(found, picture)
    assert features.flicker.max() == 0
    assert np.abs(features.forward).max() < 0.05 and np.abs(features.backward).max() < 0.05


def test_low_background_and_high_are_in_order():
    features = clip_features(random_clip(np.random.default_rng(2)))
    assert (features.low <= features.background).all() and (features.background <= features.high).all()


def test_bodies_of_a_clip_have_ids_from_1_without_gaps():
    frames, network = random_clip(np.random.default_rng(3)), random_network()
    candidates = find_candidates(frames, network)
    scores = candidate_scores(candidates, network)
    assert len(scores) == len(candidates.tracks) and ((scores >= 0) & (scores <= 1)).all()
    masks = draw_masks(candidates.tracks, candidates.probability, frames)
    assert masks.shape == frames.shape[:3] and masks.dtype == np.uint8
    assert masks.max() <= len(scores)


def test_frames_of_another_form_are_refused():
    with pytest.raises(ValueError, match="uint8"):
        find_candidates(np.zeros((5, 32, 32, 3)), random_network())
    with pytest.raises(ValueError, match="2 or more"):
        find_candidates(np.zeros((1, 32, 32, 3), np.uint8), random_network())


def test_the_shipped_weights_are_read_and_small():
    folder = Path(__file__).resolve().parents[2] / "models" / "masks"
    assert sum(file.stat().st_size for file in folder.rglob("*.safetensors")) < 10_000_000
    networks = load_mask_networks(folder)
    assert set(networks.moving.config["regression"]) == {"constant", *FIGURES}
    assert networks.outlines is not None


def test_norms_that_are_part_of_the_convolutions_change_no_answer():
    network = random_network()
    with torch.no_grad():
        for part in network.modules():
            if isinstance(part, torch.nn.BatchNorm2d):
                part.running_mean.normal_(0, 0.1)
                part.running_var.uniform_(0.5, 2.0)
        ready = without_norms(network)
        full, half = torch.rand(2, FULL_CHANNELS, 32, 32), torch.rand(2, HALF_CHANNELS, 16, 16)
        for one, other in zip(network(full, half), ready(full, half), strict=True):
            torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)
    assert not any(isinstance(part, torch.nn.BatchNorm2d) for part in ready.modules())
    assert any(isinstance(part, torch.nn.BatchNorm2d) for part in network.modules())
