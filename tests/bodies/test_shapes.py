"""The network for shapes: what it is shown, and what the one that ships says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from sampled_scenes import SCHEDULE, distribution

from pipeline.bodies.networks.body_shapes import LEAST_AREA_PX, input_of, shape_probabilities, tells_its_shape
from pipeline.bodies.networks.shape_network import INPUTS, ShapeNetwork, load_shape_network, save_shape_network
from pipeline.clips.replay import replay_poses
from pipeline.errors import ModelError
from pipeline.physics.simulate import simulate
from pipeline.scene.sample import draw_scene
from pipeline.scene.scene import BASIC_SHAPES
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_rgb

SHIPPED = Path(__file__).resolve().parents[2] / "models" / "masks"


class Disc(ShapeNetwork):
    """Says sphere where the mask fills its box as a disc does, box where it fills all of it."""

    def forward(self, squares: torch.Tensor) -> torch.Tensor:
        mask = squares[:, 3] > 0
        rows, cols = mask.any(2).sum(1), mask.any(1).sum(1)
        share = mask.sum((1, 2)) / (rows * cols)
        scores = {"sphere": -(share - 0.785).abs(), "box": -(share - 1).abs(), "cylinder": -share.new_ones(len(share))}
        return 50 * torch.stack([scores[shape] for shape in BASIC_SHAPES], 1)


def disc_and_box(count: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Frames and masks of a disc, 1, and a square, 2, at other places in each frame; 3 is never seen."""
    rows, cols = np.mgrid[:120, :160]
    masks = np.zeros((count, 120, 160), np.uint8)
    for t in range(count):
        masks[t][np.hypot(cols - 40 - t, rows - 50) < 15] = 1
        masks[t, 60 + t : 85 + t, 100:125] = 2
    return np.repeat(masks[..., None] * 80, 3, -1), masks


def test_each_instance_gets_the_answer_for_its_own_squares() -> None:
    network = Disc()
    network.config = {"independent_frames": 1.0}
    found = shape_probabilities(*disc_and_box(), 3, network)
    np.testing.assert_allclose(found.sum(1), 1, rtol=1e-5)
    assert BASIC_SHAPES[found[0].argmax()] == "sphere"
    assert BASIC_SHAPES[found[1].argmax()] == "box"
    np.testing.assert_allclose(found[2], 1 / 3)


def test_no_independent_frame_tells_nothing() -> None:
    network = Disc()
    network.config = {"independent_frames": 0.0}
    np.testing.assert_allclose(shape_probabilities(*disc_and_box(), 2, network), 1 / 3, rtol=1e-6)


def test_too_small_or_too_much_hidden_a_body_does_not_tell_its_shape() -> None:
    rows, cols = np.mgrid[:60, :60]
    disc = np.hypot(cols - 30, rows - 30) < 20
    assert tells_its_shape(disc)
    assert not tells_its_shape(disc & (cols > 33) & (cols < 35) | disc & (rows < 13))
    small = np.zeros((60, 60), bool)
    small.ravel()[: LEAST_AREA_PX - 1] = True
    assert not tells_its_shape(small)


def test_the_input_does_not_depend_on_exposure() -> None:
    frame, masks = torch.rand(2, 3, 64, 64), torch.zeros(2, 2, 64, 64)
    one, other = input_of(frame, masks), input_of(0.5 * frame + 0.2, masks)
    assert one.shape == (2, INPUTS, 64, 64)
    assert torch.allclose(one, other, atol=0.5)
    assert torch.corrcoef(torch.stack([one[:, :3].flatten(), other[:, :3].flatten()]))[0, 1] > 0.999


def test_a_saved_network_answers_the_same(tmp_path: Path) -> None:
    network = ShapeNetwork((8, 8, 8, 8)).eval()
    save_shape_network(network, tmp_path, {"independent_frames": 1.5})
    loaded = load_shape_network(tmp_path)
    assert loaded.config["independent_frames"] == 1.5
    squares = torch.rand(3, INPUTS, 64, 64)
    with torch.inference_mode():
        torch.testing.assert_close(loaded(squares), network(squares), atol=0.01, rtol=0.02)


def test_a_folder_without_weights_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"no shapes\.safetensors"):
        load_shape_network(tmp_path)


def test_the_network_that_ships_knows_shapes(rng: np.random.Generator) -> None:
    """Of 24 bodies in plain colours most are right; by chance 17 of them would be with a probability of 0.0004."""
    network, right = load_shape_network(SHIPPED), 0
    shapes = [str(s) for s in rng.permutation(np.repeat(BASIC_SHAPES, 8))]
    for shape in shapes:
        scene = draw_scene(rng, [shape], replace(distribution(), x=(-0.2, 0.2), y=(-0.2, 0.2), speed=(0.0, 0.5)))
        masks = replay_poses(scene, SCHEDULE).masks
        trace = simulate(scene, SCHEDULE.seconds)
        at = SCHEDULE.frame_steps[:: max(len(masks) // 6, 1)]
        height, width = masks.shape[1:]
        look = plain_appearance(1, 0)
        frames = render_rgb(scene, trace.position[at], trace.quaternion[at], look, width, height, "raycast", True)
        found = shape_probabilities(frames, masks[:: max(len(masks) // 6, 1)], 1, network)
        right += BASIC_SHAPES[found[0].argmax()] == shape
    assert right >= 17
