"""Laws of our RAFT."""

import numpy as np
import pytest
import torch
from published_raft import published_large, published_small
from torch.nn import functional as F

from pipeline.errors import ModelError
from pipeline.vision.flow.raft import RAFT, convex_upsample, load_raft, resize_flow, sequence_loss
from pipeline.vision.flow.raft_layers import Correlation


@pytest.fixture(autouse=True)
def one_seed(rng):
    torch.manual_seed(int(rng.integers(1 << 31)))


def random_state(shapes):
    """A state dict as published: every name with the prefix of DataParallel."""
    return {
        f"module.{k}": torch.zeros(s, dtype=torch.long) if k.endswith("tracked") else torch.rand(s) * 0.1 + 0.01
        for k, s in shapes.items()
    }


@pytest.mark.parametrize(("size", "shapes"), [("small", published_small()), ("large", published_large())])
def test_a_checkpoint_with_the_published_names_and_shapes_loads(tmp_path, size, shapes):
    state = random_state(shapes)
    for name in [k for k in state if ".norm3." in k]:  # one tensor under two names, as in the release
        state[name] = state[name.replace(".norm3.", ".downsample.1.")]
    torch.save(state, tmp_path / "raft.pth")
    model = load_raft(tmp_path / "raft.pth")
    assert model.size == size
    for name, value in model.state_dict().items():
        assert torch.equal(value, state[f"module.{name}"]), name


def test_the_published_small_network_has_990_thousand_parameters_and_the_large_one_5_3_million():
    assert sum(p.numel() for p in RAFT("small").parameters()) == 990_162
    assert sum(p.numel() for p in RAFT("large").parameters()) == 5_257_536


@pytest.mark.parametrize("convex", [False, True])
def test_what_is_saved_is_loaded_and_gives_the_same_flow(tmp_path, rng, convex):
    model = RAFT("small", convex_upsampling=convex).eval()
    model.save(tmp_path / "weights")
    a, b = rng.integers(0, 256, (2, 1, 64, 72, 3), np.uint8)
    assert np.array_equal(load_raft(tmp_path / "weights").flow(a, b, 2), model.flow(a, b, 2))


def naive_lookup(a, b, position, radius):
    """Each sample by hand: the level's mean feature map, bilinearly, times the feature of a."""
    _, d, h, w = a.shape
    out = []
    for level in range(4):
        pooled = b
        for _ in range(level):
            pooled = F.avg_pool2d(pooled, 2, stride=2)
        samples = np.zeros((2 * radius + 1, 2 * radius + 1, h, w))
        for i in range(h):
            for j in range(w):
                x0, y0 = (float(v) / 2**level for v in position[0, :, i, j])
                for kx in range(-radius, radius + 1):
                    for ky in range(-radius, radius + 1):
                        x, y = x0 + kx, y0 + ky
                        total = 0.0
                        for cx in (int(np.floor(x)), int(np.floor(x)) + 1):
                            for cy in (int(np.floor(y)), int(np.floor(y)) + 1):
                                if 0 <= cx < pooled.shape[3] and 0 <= cy < pooled.shape[2]:
                                    weight = (1 - abs(x - cx)) * (1 - abs(y - cy))
                                    total += weight * float(a[0, :, i, j] @ pooled[0, :, cy, cx])
                        samples[kx + radius, ky + radius, i, j] = total / d**0.5
        out.append(samples.reshape(-1, h, w))
    return np.concatenate(out)


def test_the_correlation_lookup_agrees_with_one_written_out_sample_by_sample():
    a, b = torch.randn(2, 1, 4, 8, 9).unbind(0)
    y, x = torch.meshgrid(torch.arange(8.0), torch.arange(9.0), indexing="ij")
    position = torch.stack([x, y])[None] + 3 * torch.randn(1, 2, 8, 9)
    ours = Correlation(a, b, radius=2).lookup(position)[0].numpy()
    assert np.allclose(ours, naive_lookup(a, b, position, 2), atol=1e-4)


def test_convex_upsampling_of_a_uniform_flow_is_uniform_inside():
    flow = torch.tensor([0.5, -0.25]).view(1, 2, 1, 1).expand(1, 2, 5, 6)
    up = convex_upsample(flow, torch.randn(1, 576, 5, 6))
    assert up.shape == (1, 2, 40, 48)
    inside = up[..., 8:-8, 8:-8]
    assert torch.allclose(inside, 8 * flow[:, :, :1, :1].expand_as(inside), atol=1e-5)


def test_convex_upsampling_stays_within_the_neighbours():
    flow = torch.rand(1, 2, 5, 6) + 1
    up = convex_upsample(flow, 10 * torch.randn(1, 576, 5, 6))[..., 8:-8, 8:-8]
    assert up.min() >= 8 * flow.min() - 1e-4
    assert up.max() <= 8 * flow.max() + 1e-4


def test_frames_of_any_size_get_a_flow_of_that_size(rng):
    model = RAFT("small")
    for height, width in ((37, 50), (64, 64), (90, 131)):
        a, b = rng.integers(0, 256, (2, 3, height, width, 3), np.uint8)
        flow = model.flow(a, b, 1, batch=2)
        assert flow.shape == (3, height, width, 2)
        assert flow.dtype == np.float32


def test_pairs_of_a_batch_do_not_touch_each_other(rng):
    model = RAFT("small", convex_upsampling=True)
    a, b = rng.integers(0, 256, (2, 3, 64, 80, 3), np.uint8)
    together = model.flow(a, b, 2)
    alone = np.concatenate([model.flow(a[i : i + 1], b[i : i + 1], 2) for i in range(3)])
    assert np.allclose(together, alone, atol=1e-3)


def test_a_smaller_working_size_scales_the_flow_back():
    flow = torch.ones(1, 2, 40, 60)
    larger = resize_flow(flow, (80, 180))
    assert larger.shape == (1, 2, 80, 180)
    assert torch.allclose(larger[:, 0], torch.tensor(3.0))
    assert torch.allclose(larger[:, 1], torch.tensor(2.0))


def test_the_sequence_loss_weighs_iterations_by_gamma_and_ignores_unknown_pixels(rng):
    truth = torch.zeros(1, 2, 8, 8)
    flows = [torch.full((1, 2, 8, 8), float(v)) for v in (3, 2, 1)]
    weight = torch.zeros(1, 8, 8)
    weight[0, 2, 3] = 1
    flows[2][0, :, 0, 0] = 1e6  # where nothing is known
    expected = 2 * (0.8**2 * 3 + 0.8 * 2 + 1)
    assert float(sequence_loss(flows, truth, weight)) == pytest.approx(expected, rel=1e-5)


def test_a_missing_checkpoint_says_where_weights_come_from(tmp_path):
    with pytest.raises(ModelError, match=r"no RAFT weights at .*none\.pth.*models/raft-small.*princeton-vl/RAFT"):
        load_raft(tmp_path / "none.pth")


def test_a_folder_without_weights_and_a_file_of_something_else_are_named(tmp_path):
    with pytest.raises(ModelError, match=r"has no model\.safetensors"):
        load_raft(tmp_path)
    (tmp_path / "text.pth").write_text("no weights")
    with pytest.raises(ModelError, match=r"text\.pth is not a PyTorch checkpoint"):
        load_raft(tmp_path / "text.pth")
    (tmp_path / "model.safetensors").write_bytes(b"broken")
    with pytest.raises(ModelError, match=r"model\.safetensors cannot be read"):
        load_raft(tmp_path)


def test_a_checkpoint_of_another_network_is_refused(tmp_path):
    torch.save({"weight": torch.zeros(3)}, tmp_path / "other.pth")
    with pytest.raises(ModelError, match=r"other\.pth does not contain the weights of RAFT"):
        load_raft(tmp_path / "other.pth")


def test_frames_that_are_not_uint8_rgb_are_refused():
    with pytest.raises(ValueError, match="uint8"):
        RAFT("small").flow(np.zeros((1, 64, 64, 3)), np.zeros((1, 64, 64, 3)))
    with pytest.raises(ValueError, match="two arrays"):
        RAFT("small").flow(np.zeros((1, 64, 64, 3), np.uint8), np.zeros((2, 64, 64, 3), np.uint8))


def test_a_warm_start_that_no_iteration_changes_comes_out_as_it_went_in():
    model = RAFT("small")
    torch.nn.init.zeros_(model.update_block.flow_head.conv2.weight)
    torch.nn.init.zeros_(model.update_block.flow_head.conv2.bias)
    start = torch.tensor([3.0, -2.0]).view(1, 2, 1, 1).expand(1, 2, 64, 72)
    images = torch.rand(2, 1, 3, 64, 72) * 255
    (flow,) = model(images[0], images[1], 1, start=start)
    assert torch.allclose(flow, start, atol=1e-4)


def test_the_weights_say_whether_they_refine_another_flow(tmp_path):
    for preset in (None, "fast"):
        RAFT("small", warm_start=preset).save(tmp_path / "weights")
        assert load_raft(tmp_path / "weights").warm_start == preset
    (tmp_path / "weights" / "config.json").write_text("{")
    with pytest.raises(ModelError, match=r"config\.json is missing or damaged"):
        load_raft(tmp_path / "weights")
