"""The model that reads objects: what it is shown, its numbers, and its answers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.errors import ModelError
from pipeline.inference.answers import ask
from pipeline.inference.loading import load_answering
from pipeline.language.completion import completion_grammar, read_completion
from pipeline.language.grammar import split
from pipeline.model.model_input import ModelInput
from pipeline.model.sampling import Sampling
from pipeline.objects.answering import ObjectsModel, write_answers
from pipeline.objects.batch import groups_of, joined, loss_sums, mean_losses, mirrored, total
from pipeline.objects.checkpoint import is_objects
from pipeline.objects.example import Example, example_of, motions
from pipeline.objects.fields import (
    BINS,
    NOTHING,
    OBJECT_FIELDS,
    SCENE_FIELDS,
    object_numbers,
    object_of,
    off_scale,
    on_scale,
    scene_numbers,
    scene_of,
)
from pipeline.objects.instances import LEAST_PX, SIDE, instances_of
from pipeline.objects.network import ObjectsNetwork, ObjectsSize
from pipeline.objects.number_chain import NumberChain, at_quantile, greedy
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import BASIC_SHAPES, Scene
from tests.sampled_scenes import clips as sampled_clips

SCHEDULE = Schedule()
SMALL = ObjectsSize(width=24, heads=2, own_blocks=1, blocks=1, channels=(4, 4, 4))
INPUT = ModelInput.of("objects", "channels", "exact", (240, 160), 4, True)


def masks_and_flow(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two rectangles that move to the right, the second one gone in the last frame, on noisy flow."""
    masks = np.zeros((10, 160, 240), np.uint8)
    for t in range(10):
        masks[t, 40:80, 20 + 4 * t : 60 + 4 * t] = 1
        if t < 9:
            masks[t, 100:120, 150 + 2 * t : 200 + 2 * t] = 2
    return masks, rng.normal(0, 1, (10, 160, 240, 2)).astype(np.float32)


def model() -> ObjectsModel:
    torch.manual_seed(0)
    network = ObjectsNetwork(SMALL)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    return ObjectsModel(network.eval(), INPUT, "small")


@pytest.fixture(scope="module")
def clip() -> tuple[Scene, Example]:
    scene = next(c.scene for c in sampled_clips(3, 6) if len(c.scene.objects) == 2)
    poses = trace_pairs(simulate(scene, SCHEDULE.seconds), SCHEDULE)
    view = pair_view(scene, *poses, 240, 160)
    return scene, example_of(scene, view.mask, view.flow, poses, SCHEDULE, None)


def test_a_crop_shows_its_body_at_its_own_scale(rng: np.random.Generator) -> None:
    masks, flow = masks_and_flow(rng)
    seen = instances_of(masks, flow)
    assert len(seen) == 2 and seen.crops.shape == (2, 10, 4, SIDE, SIDE)
    np.testing.assert_array_equal(seen.places[0, 3, :8], [1, 32, 72, 40, 80, 52, 60, 1600])
    np.testing.assert_allclose(seen.places[0, 3, 8:10], flow[3][masks[3] == 1].mean(0), atol=1e-4)
    assert not seen.places[1, 9].any() and not seen.crops[1, 9].any()
    shifted = instances_of(np.roll(masks, 5, 2), np.roll(flow, 5, 2))
    np.testing.assert_array_equal(shifted.crops[0], seen.crops[0])


def test_small_and_missing_bodies_are_left_out(rng: np.random.Generator) -> None:
    masks, flow = masks_and_flow(rng)
    masks[masks == 1] = 0
    masks[0, 0, : LEAST_PX - 1] = 1
    assert instances_of(masks, flow).ids.tolist() == [2]
    assert len(instances_of(np.zeros_like(masks), flow)) == 0


def test_pictures_of_another_size_give_the_same_places(rng: np.random.Generator) -> None:
    masks, flow = masks_and_flow(rng)
    large = instances_of(masks.repeat(2, 1).repeat(2, 2), 2 * flow.repeat(2, 1).repeat(2, 2))
    np.testing.assert_allclose(large.places[..., :8], instances_of(masks, flow).places[..., :8])


def test_an_example_in_a_mirror_is_the_example_of_the_mirrored_clip(rng: np.random.Generator, clip: tuple) -> None:
    masks, flow = masks_and_flow(rng)
    _, example = clip
    group = next(groups_of(joined([replace(example, instances=instances_of(masks, flow))]), np.arange(1)))
    turned = instances_of(masks[:, :, ::-1], flow[:, :, ::-1] * np.array([-1, 1], np.float32))
    found = mirrored(group)
    np.testing.assert_allclose(found["places"][0].numpy(), turned.places, atol=1e-3)
    assert np.abs(found["crops"][0].numpy().astype(int) - turned.crops).max() <= 1
    again = mirrored(found)
    assert all(torch.equal(again[name], group[name]) for name in ("values", "motion", "crops"))


def test_numbers_of_a_scene_give_the_scene() -> None:
    for clip in sampled_clips(4, 12):
        scene = clip.scene
        numbers = np.array([object_numbers(o) for o in scene.objects])
        found = scene_of(scene_numbers(scene), list(scene.shapes), numbers)
        assert found.composition == scene.composition and found.camera == scene.camera
        for a, b in zip(found.objects, scene.objects, strict=True):
            np.testing.assert_allclose(a.position, b.position, atol=0.0035)
            np.testing.assert_allclose(a.orientation, b.orientation, atol=0.002)
            assert a.size == b.size and a.velocity == b.velocity and a.angular_velocity == b.angular_velocity


@pytest.mark.parametrize("fields", [SCENE_FIELDS, OBJECT_FIELDS])
def test_scales_are_undone(fields: tuple) -> None:
    values = torch.tensor([[0.3 + 0.01 * k for k in range(len(fields))]])
    torch.testing.assert_close(off_scale(on_scale(values, fields), fields), values)


def test_impossible_numbers_become_the_nearest_body() -> None:
    wild = np.full(len(OBJECT_FIELDS), -5.0)
    body = object_of("box", wild)
    assert min(body.size) > 0 and body.mass > 0 and abs(np.linalg.norm(body.orientation) - 1) < 1e-6


def test_a_number_is_learned_and_read_back() -> None:
    torch.manual_seed(0)
    chain = NumberChain(SCENE_FIELDS, 16)
    soft = chain.soft_targets(torch.tensor([[-20.0, 1.0, 40.0, 9.81]]))
    torch.testing.assert_close(soft.sum(-1), torch.ones(1, 4))
    for k, value in enumerate((-20.0, 1.0, 40.0, 9.81)):
        field = SCENE_FIELDS[k]
        place = greedy(soft[:, k], field)
        assert abs(field.low + float(place) * (field.high - field.low) / (BINS - 1) - value) < 0.02 * (
            field.high - field.low
        )
    p = torch.full((2, BINS), 1 / BINS)
    places = at_quantile(p, torch.tensor([0.25, 0.75]), SCENE_FIELDS[0])
    assert 14 < places[0] < 17 and 47 < places[1] < 50


def test_motions_are_those_of_the_poses(clip: tuple[Scene, Example]) -> None:
    scene, example = clip
    trace = simulate(scene, SCHEDULE.seconds)
    found = motions(*trace_pairs(trace, SCHEDULE), SCHEDULE)
    np.testing.assert_allclose(found[:, 0, :3], [o.position for o in scene.objects], atol=1e-6)
    np.testing.assert_allclose(example.motion[:, 0], found[example.instances.ids - 1][:, 0])


def test_training_lowers_the_loss(clip: tuple[Scene, Example]) -> None:
    torch.manual_seed(0)
    network, rng = ObjectsNetwork(SMALL), np.random.default_rng(0)
    groups = list(groups_of(joined([clip[1]] * 2), np.arange(2)))
    optimizer = torch.optim.Adam(network.parameters(), 3e-3)
    losses = []
    for _ in range(30):
        loss = total(mean_losses(groups, [loss_sums(network, g, rng) for g in groups]))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.8 * losses[0]


def test_answers_are_texts_of_the_grammar_and_samples_differ(clip: tuple[Scene, Example]) -> None:
    seen = clip[1].instances
    (answers,) = ask(model(), lambda _: seen, [3], Sampling(8, 1.0), 64)
    assert len(answers) == 9 and len({a.text for a in answers}) == 9
    for answer in answers:
        split(completion_grammar(True, 1.0), answer.text)
        assert 1 <= len(answer.scene.objects) <= len(seen) and answer.log_probability < 0
    again = ask(model(), lambda _: seen, [3], Sampling(8, 1.0), 64)[0]
    assert [a.text for a in again] == [a.text for a in answers]
    (silent,) = write_answers(model(), seen, Sampling(reasoning=False), 0)
    assert "<think>" not in silent.text and read_completion(silent.text).scene == answers[0].scene


def test_an_instance_that_is_no_body_is_left_out(clip: tuple[Scene, Example]) -> None:
    seen, own = clip[1].instances, model()
    with torch.no_grad():
        own.model.bodies.choose[-1].bias[NOTHING] = 50.0
    (answer,) = write_answers(own, seen, Sampling(), 0)
    assert len(read_completion(answer.text).scene.objects) == 1  # an answer has one at least
    empty = instances_of(np.zeros((10, 160, 240), np.uint8), np.zeros((10, 160, 240, 2), np.float32))
    with pytest.raises(ModelError, match="masks of this clip have none"):
        write_answers(own, empty, Sampling(), 0)


@pytest.mark.parametrize("shape", BASIC_SHAPES)
def test_a_body_with_a_sure_shape_prior_gets_that_shape(clip: tuple[Scene, Example], shape: str) -> None:
    seen = clip[1].instances
    sure = np.eye(len(BASIC_SHAPES))[[BASIC_SHAPES.index(shape)] * len(seen)]
    (answer,) = write_answers(model(), replace(seen, shape_prior=sure), Sampling(), 0)
    assert set(read_completion(answer.text).scene.shapes) == {shape}
    (plain,) = write_answers(model(), seen, Sampling(), 0)
    (same,) = write_answers(model(), replace(seen, shape_prior=np.full((len(seen), 3), 1 / 3)), Sampling(), 0)
    assert same.text == plain.text


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path, clip: tuple[Scene, Example]) -> None:
    own = model()
    own.save(tmp_path / "m")
    again = load_answering(str(tmp_path / "m"))
    assert isinstance(again, ObjectsModel) and again.input == INPUT and is_objects(str(tmp_path / "m"))
    seen = clip[1].instances
    assert write_answers(again, seen, Sampling(), 0) == write_answers(own, seen, Sampling(), 0)
    with pytest.raises(ModelError, match="10 frames a clip; 5 cannot be shown"):
        load_answering(str(tmp_path / "m"), frames=5)
    (tmp_path / "m" / "model.safetensors").write_bytes(b"")
    with pytest.raises(ModelError, match="has no model that reads objects"):
        load_answering(str(tmp_path / "m"))
