"""Examples for the training of the words model, and the loss on them."""

import numpy as np
import pytest
import torch
from tiny_words import tiny_words

from pipeline.clips.events import Event
from pipeline.model import decisions as d
from pipeline.model.fields import NOTHING, OBJECT_FIELDS, SCENE_FIELDS, off_scale
from pipeline.model.instances import HEIGHT, WIDTH
from pipeline.model.shown import FRAME_SIZE, SeenBodies, SeenFrames, seen_bodies
from pipeline.model.words_example import (
    Arrays,
    Truth,
    bodies_example,
    chosen,
    frames_example,
    groups_of,
    motions,
    stacked,
    truth_of,
)
from pipeline.model.words_loss import MIX, losses, means, soft_targets
from pipeline.model.words_network import FRAMES, WordsNetwork
from pipeline.scene.rotation import quaternion_multiply
from pipeline.scene.scene import Camera, Scene, SceneObject

EVENTS = [
    Event(0.05, "hits_ground", 0),
    Event(0.31, "hits_object", 0, 1),
    Event(0.77, "stops_rolling", 1),
    Event(1.0, "leaves", 0),
]


@pytest.fixture
def network() -> WordsNetwork:
    return tiny_words()


def seen_of(bodies: int, rgb: bool = False) -> SeenBodies:
    """Squares that move to the right, one body with id k + 1 in each place."""
    masks = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    for k in range(bodies):
        for t in range(FRAMES):
            masks[t, 10 + 35 * k :, 10 + 3 * t :][: 20 + k, :20] = k + 1
    flow = np.stack([(masks > 0).astype(np.float32), np.zeros(masks.shape, np.float32)], -1)
    frames = np.random.default_rng(0).integers(256, size=(FRAMES, HEIGHT, WIDTH, 3), dtype=np.uint8)
    return seen_bodies(masks, flow, frames if rgb else None)


def frames_of(rgb: bool) -> SeenFrames:
    shape = (FRAMES, 3 if rgb else 2, FRAME_SIZE[1], FRAME_SIZE[0])
    return SeenFrames(np.random.default_rng(0).integers(-127, 128, shape).astype(np.int8))


def truth(bodies: int, events: list[Event] = EVENTS) -> Truth:
    """Bodies of shapes 0, 1, 2, 0, ... with values that tell them apart."""
    rng = np.random.default_rng(bodies)
    low, high = (np.array([getattr(f, k) for f in OBJECT_FIELDS]) for k in ("low", "high"))
    return Truth(
        np.array([rng.uniform(f.low, f.high) for f in SCENE_FIELDS], np.float32),
        (np.arange(bodies) % NOTHING).astype(np.int8),
        rng.uniform(low, high, (bodies, len(OBJECT_FIELDS))).astype(np.float32),
        rng.standard_normal((bodies, FRAMES, 9)).astype(np.float32),
        [e for e in events if max(e.objects) < bodies],
    )


def example(bodies: int, rgb: bool = False, real: int | None = None, seed: int = 0) -> Arrays:
    """An example of so many instances, of which the first `real` are bodies; three answers."""
    rng = np.random.default_rng(seed)
    return bodies_example(seen_of(bodies, rgb), truth(bodies if real is None else real), (True, False, True), rng)


# Order


@pytest.mark.parametrize("which", [0, 1, 2])
def test_gathered_bodies_stand_in_the_order_of_the_answer(which: int) -> None:
    examples = [example(4, real=3, seed=s) for s in range(6)]
    arrays = {k: torch.from_numpy(v) for k, v in stacked(examples).items()}
    group = chosen(arrays, torch.arange(6), torch.full((6,), which))
    true = truth(3)
    orders = set()
    for row in range(6):
        asked = group["ask"][row] == d.ASK_SHAPE
        assert group["shapes"][row].tolist() == (group["choice"][row][asked] - d.SHAPE0).tolist()
        assert (d.PLACE0 + group["numbers"][row]).tolist() == group["of"][row][asked].tolist()
        order = arrays["order"][row, which].tolist()
        orders.add(tuple(order))
        for i, j in enumerate(order):
            for name in ("crops", "places", "motion", "soon"):
                assert torch.equal(group[name][row, i], arrays[name][row, j])
            own = group["of"][row] == d.PLACE0 + group["numbers"][row, i]
            mass = own & (group["field"][row] == 1 + len(SCENE_FIELDS) + _index("mass"))
            if j < 3:
                share = d.share_of(true.values[j, _index("mass")], 1 + len(SCENE_FIELDS) + _index("mass"))
                assert group["number"][row][mass].tolist() == pytest.approx([share], abs=1e-6)
                assert torch.equal(group["motion"][row, i], torch.from_numpy(true.motion[j]))
            else:
                assert group["shapes"][row, i] == NOTHING
                assert not mass.any()
                assert not group["motion"][row, i].any()
    assert len(orders) > 1


def _index(name: str) -> int:
    return [f.name for f in OBJECT_FIELDS].index(name)


def test_events_are_told_of_the_places_of_their_bodies() -> None:
    made = example(3)
    for which in (0, 2):
        place_of = {int(j): int(p) for j, p in zip(made["order"][which], made["numbers"][which], strict=True)}
        choices = made["choice"][which]
        told = [
            tuple(int(c) for c in choices[made["ask"][which] == ask]) for ask in (d.ASK_WHO, d.ASK_KIND, d.ASK_WHOM)
        ]
        assert told[0] == tuple(d.PLACE0 + place_of[e.first] for e in EVENTS)
        assert told[1] == tuple(d.KIND0 + d.KINDS.index(e.kind) for e in EVENTS)
        assert told[2] == (d.PLACE0 + place_of[1],)
        times = (made["number"][which][made["ask"][which] == d.ASK_FIELD] + 1) / 2
        assert times.tolist() == pytest.approx([e.time for e in EVENTS], abs=1e-6)
    assert not (made["ask"][1] == d.ASK_EVENT).any()  # an answer without `<think>`


def test_events_of_bodies_that_are_not_seen_are_left_out() -> None:
    true = truth(3, [*EVENTS, Event(0.4, "hits_object", 1, 2), Event(0.9, "enters", 2)])
    made = bodies_example(seen_of(2), true, (True,), np.random.default_rng(0))
    assert (made["ask"][0] == d.ASK_WHO).sum() == len(EVENTS)
    assert made["shapes"].tolist() == [0, 1]


def test_a_frame_names_bodies_in_the_order_of_the_truth_and_then_none() -> None:
    made = frames_example(frames_of(False), truth(3), (True, False))
    for which in (0, 1):
        shapes = made["choice"][which][made["ask"][which] == d.ASK_SHAPE] - d.SHAPE0
        assert shapes.tolist() == [0, 1, 2, NOTHING]


def test_places_are_drawn_in_increasing_order() -> None:
    numbers = np.concatenate([example(3, seed=s)["numbers"] for s in range(20)])
    assert (np.diff(numbers, axis=1) > 0).all()
    assert set(numbers.flatten().tolist()) == set(range(d.PLACES))


# What comes soon


@pytest.mark.parametrize("k", range(FRAMES))
@pytest.mark.parametrize("into", [0.0, 0.5, 0.99])
def test_soon_marks_the_frame_in_whose_interval_an_event_lies(k: int, into: float) -> None:
    steps = (k + into) * 240 / FRAMES  # events lie on steps of the simulation
    time = round(steps) / 240 if into < 0.9 else (k + into) / FRAMES
    made = bodies_example(seen_of(3), truth(3, [Event(time, "hits_object", 0, 2)]), (True,), np.random.default_rng(0))
    wanted = np.zeros((3, FRAMES, len(d.KINDS)), np.int8)
    wanted[[0, 2], k, d.KINDS.index("hits_object")] = 1
    assert np.array_equal(made["soon"], wanted)


def test_an_event_at_the_end_of_the_clip_lies_in_the_last_interval() -> None:
    made = bodies_example(seen_of(1), truth(1, [Event(1.0, "leaves", 0)]), (True,), np.random.default_rng(0))
    assert np.argwhere(made["soon"]).tolist() == [[0, FRAMES - 1, d.KINDS.index("leaves")]]


# Truth


def test_the_truth_of_a_scene_is_its_numbers() -> None:
    ball = SceneObject(shape="sphere", size=(0.1,), mass=0.7, position=(0.2, 0.3, 0.4), velocity=(1.0, -1.0, 0.5))
    block = SceneObject(
        shape="box", size=(0.2, 0.3, 0.4), mass=2.0, position=(-0.2, 0.1, 0.2), angular_velocity=(0, 3, 0)
    )
    scene = Scene((ball, block), Camera((0.0, -2.0, 1.0), fov=40.0, pitch=-20.0), (0.0, 0.0, -9.0))
    events = [Event(0.5, "hits_fixed", 0, 0), Event(1.0, "hits_object", 0, 1)]
    found = truth_of(scene, np.zeros((2, FRAMES, 9), np.float32), events, 2.0)
    assert found.events == [Event(0.5, "hits_object", 0, 1)]
    assert [["sphere", "cylinder", "box"][k] for k in found.shapes] == ["sphere", "box"]
    numbers = off_scale(torch.from_numpy(found.values), OBJECT_FIELDS).numpy()
    for name, wanted in (
        ("gap", (0.3, 0.0)),
        ("mass", (0.7, 2.0)),
        ("velocity y", (-1, 0)),
        ("spin y", (0, 3)),
        ("size 2", (0, 0.4)),
    ):
        assert numbers[:, _index(name)].tolist() == pytest.approx(list(wanted), abs=1e-6)
    assert off_scale(torch.from_numpy(found.scene), SCENE_FIELDS).tolist() == pytest.approx([-20, 1, 40, 9], rel=1e-6)


def test_motions_are_the_velocity_and_spin_of_uniform_motion() -> None:
    rng = np.random.default_rng(0)
    velocity, spin = rng.standard_normal((2, 3)), 5 * rng.standard_normal((2, 3))
    times = np.stack([np.arange(FRAMES) * 0.1, np.arange(FRAMES) * 0.1 + 1 / 30], 1)  # (T, 2)
    position = times[..., None, None] * velocity
    angle = times[..., None, None] * np.linalg.norm(spin, axis=1)[:, None]
    axis = spin / np.linalg.norm(spin, axis=1)[:, None]
    turned = np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * axis], -1)
    start = np.array([0.5, -0.5, 0.1, 0.7]) / np.linalg.norm([0.5, -0.5, 0.1, 0.7])
    quaternion = quaternion_multiply(turned, np.broadcast_to(start, turned.shape))
    quaternion[3, 1] *= -1  # the same rotation
    found = motions(position, quaternion, 1 / 30)
    assert found.shape == (2, FRAMES, 9)
    assert np.abs(found[..., :3] - position[:, 0].transpose(1, 0, 2)).max() < 1e-6
    assert np.abs(found[..., 3:6] - velocity[:, None]).max() < 1e-5
    assert np.abs(found[..., 6:] - spin[:, None]).max() < 1e-4
    assert not motions(position, np.broadcast_to(start, turned.shape), 1 / 30)[..., 6:].any()


# Losses

#: Parameters that no loss of an example of whole frames reaches: what is said of single bodies.
OF_BODIES = ("place.", "frame.", "beside.")


def gradients(network: WordsNetwork, examples: list[Arrays], colours: bool) -> set[str]:
    """Names of the parameters with a gradient that is nowhere infinite and not zero everywhere."""
    network.zero_grad()
    for group in groups_of(examples):
        found = means(network, group, colours)
        assert all(v.isfinite() and v >= 0 for v in found.values())
        assert set(found) == set(MIX) - ({"beside"} if "frames" in group else set())
        sum(found.values(), torch.zeros(())).backward()
    reached = {name: p.grad for name, p in network.named_parameters() if p.grad is not None}
    assert all(g.isfinite().all() for g in reached.values())
    return {name for name, g in reached.items() if g.any()}


@pytest.mark.parametrize("rgb", [False, True])
def test_losses_of_bodies_are_finite_and_reach_every_parameter(network: WordsNetwork, rgb: bool) -> None:
    examples = [example(2, rgb), example(3, rgb), example(3, rgb, real=2, seed=1), example(1, rgb)]
    assert gradients(network, examples, rgb) == {name for name, _ in network.named_parameters()}


@pytest.mark.parametrize("rgb", [False, True])
def test_losses_of_frames_are_finite_and_reach_every_parameter_but_those_of_bodies(
    network: WordsNetwork, rgb: bool
) -> None:
    examples = [frames_example(frames_of(rgb), truth(n), (True, False)) for n in (1, 3)]
    names = {name for name, _ in network.named_parameters() if not name.startswith(OF_BODIES)}
    assert gradients(network, examples, rgb) == names


def test_groups_have_the_first_answer_of_each_example_and_one_number_of_bodies() -> None:
    examples = [example(2), example(3), example(2, seed=1), frames_example(frames_of(False), truth(2), (True,))]
    groups = list(groups_of(examples))
    assert sorted(len(g["ask"]) for g in groups) == [1, 1, 2]
    assert sum("frames" in g for g in groups) == 1
    pair = next(g for g in groups if len(g["ask"]) == 2)
    for row, made in enumerate((examples[0], examples[2])):
        length = int((made["ask"][0] > 0).sum())
        assert pair["token"][row, :length].tolist() == made["token"][0, :length].tolist()
        assert not pair["ask"][row, length:].any()


@torch.no_grad()
def test_losses_of_a_batch_are_the_sums_of_those_of_its_examples(network: WordsNetwork) -> None:
    examples = [example(3, seed=s, real=n) for s, n in enumerate((3, 2, 3))]  # answers of different lengths
    together = losses(network, next(groups_of(examples)), False)
    alone = [losses(network, next(groups_of([e])), False) for e in examples]
    for name, value in together.items():
        assert float(value) == pytest.approx(sum(float(a[name]) for a in alone), rel=1e-4)


@torch.no_grad()
def test_what_stands_behind_a_shorter_answer_does_not_count(network: WordsNetwork) -> None:
    group = next(groups_of([example(2)]))
    longer = {
        k: torch.nn.functional.pad(v, (0, 7), value=-1 if k in ("choice", "field") else 0) if k in d.ANSWER_TYPES else v
        for k, v in group.items()
    }
    one, other = losses(network, group, False), losses(network, longer, False)
    for name, value in one.items():
        assert float(other[name]) == pytest.approx(float(value), rel=1e-5)


@torch.no_grad()
def test_a_scene_that_is_said_twice_costs_by_clip_as_much_as_once(network: WordsNetwork) -> None:
    made = example(2)
    once, twice = (means(network, next(groups_of([made] * k)), False) for k in (1, 2))
    for name, value in once.items():
        assert float(twice[name]) == pytest.approx(float(value), rel=1e-4)


def test_soft_targets_are_distributions_whose_mean_is_the_number() -> None:
    number = torch.linspace(-0.9, 0.9, 41)
    for k, field in enumerate(d.FIELDS):
        targets = soft_targets(number, torch.full((41,), k))
        torch.testing.assert_close(targets.sum(-1), torch.ones(41))
        mean = (targets * torch.linspace(-1, 1, targets.shape[1])).sum(-1)
        torch.testing.assert_close(mean, number, rtol=0, atol=1e-4 if not field.zero else 0.02)


def test_the_target_of_an_exact_zero_is_its_own_bin_where_the_field_has_one() -> None:
    for k, field in enumerate(d.FIELDS):
        if field.low <= 0 <= field.high:
            share = torch.tensor([d.share_of(0.0, k)], dtype=torch.float32)
            (target,) = soft_targets(share, torch.tensor([k]))
            assert (target.max() == 1) == field.zero, field.name


def test_a_clip_in_which_no_body_is_seen_is_left_out() -> None:
    nothing = seen_bodies(np.zeros((10, 160, 240), np.uint8), np.zeros((10, 160, 240, 2), np.float32), None)
    truth = Truth(
        np.zeros(4, np.float32),
        np.zeros(1, np.int8),
        np.zeros((1, 19), np.float32),
        np.zeros((1, 10, 9), np.float32),
        [],
    )
    example = bodies_example(nothing, truth, [True], np.random.default_rng(0))
    assert list(groups_of([example])) == []
