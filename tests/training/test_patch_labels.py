"""Labels of patches, and the head that learns them."""

import numpy as np
import pytest
import torch

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.model.patches import PatchLayout
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import BASIC_SHAPES, Camera, Scene, SceneObject
from training.tiny.patch_labels import PatchHead, PatchLabels, patch_labels

LAYOUT = PatchLayout(192, 128, 10, patch=16, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))


@pytest.fixture
def labelled(rng: np.random.Generator) -> tuple[Scene, PatchLabels]:
    ball = SceneObject("sphere", (0.22,), 1.0, position=(-0.4, 0.2, 0.22), velocity=(rng.uniform(0.05, 0.15), 0, 0))
    box = SceneObject("box", (0.4, 0.4, 0.4), 1.0, position=(0.45, 0.2, 0.2))
    scene = Scene((ball, box), Camera((0, -2, 1.0), 45.0, -20.0))
    schedule = Schedule()
    trace = simulate(scene, schedule.seconds)
    view = pair_view(scene, *trace_pairs(trace, schedule), LAYOUT.width, LAYOUT.height)
    return scene, patch_labels(view, scene, trace, schedule, LAYOUT)


def test_patches_are_labelled_with_their_object(labelled: tuple[Scene, PatchLabels]) -> None:
    scene, labels = labelled
    t, h, w = LAYOUT.grid
    assert labels.shape.shape == labels.place.shape == (t, h, w)
    middle = w // 2
    for place, side in ((0, np.s_[:, :, :middle]), (1, np.s_[:, :, middle:])):
        mine = labels.shape[side] == 1 + BASIC_SHAPES.index(scene.shapes[place])
        assert mine.any() and set(np.unique(labels.shape[side])) <= {0, 1 + BASIC_SHAPES.index(scene.shapes[place])}
        assert (labels.place[side][mine] == place).all()
        numbers = labels.numbers[side][mine]
        np.testing.assert_allclose(
            numbers[:, 15:18], np.tile(scene.objects[place].position, (len(numbers), 1)), atol=1e-6
        )
        np.testing.assert_allclose(np.exp(numbers[:, 6:9]), (0.22, 0.2)[place], rtol=0.05)  # half extents
        np.testing.assert_allclose(np.exp(numbers[:, 3]), scene.objects[place].size[0], rtol=1e-6)
    assert (labels.numbers[labels.shape == 0] == 0).all()


def test_offsets_of_an_objects_patches_point_at_one_place(labelled: tuple[Scene, PatchLabels]) -> None:
    _, labels = labelled
    rows, columns = np.nonzero(labels.shape[0] == 1 + BASIC_SHAPES.index("sphere"))
    numbers = labels.numbers[0, rows, columns]
    assert np.ptp(columns + numbers[:, 1]) < 1e-4 and np.ptp(rows + numbers[:, 2]) < 1e-4


def test_the_head_learns_the_labels_in_the_tokens_order(labelled: tuple[Scene, PatchLabels]) -> None:
    _, labels = labelled
    torch.manual_seed(0)
    head, tokens = PatchHead(64, LAYOUT), torch.randn(2 * LAYOUT.tokens, 64)
    optimizer = torch.optim.Adam(head.parameters(), 0.02)
    first = head(tokens, [labels, labels]).item()
    for _ in range(60):
        loss = head(tokens, [labels, labels])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.5 * first and head.shapes_right(tokens, [labels, labels]) > 0.9
    blocks = head.blocks([labels.numbers, labels.numbers], tokens.device)
    m = LAYOUT.merge
    np.testing.assert_array_equal(blocks[: m * m].numpy(), labels.numbers[0, :m, :m].reshape(m * m, -1))
