"""The network of the words model: vision tower, prompts, causality, cache, and what a checkpoint keeps."""

from pathlib import Path

import pytest
import torch
from tiny_words import TINY, tiny_words
from torch import Tensor
from transformers import DynamicCache

from pipeline.errors import ModelError
from pipeline.model import decisions as d
from pipeline.model.instances import HEIGHT, SIDE, WIDTH
from pipeline.model.model_input import ModelInput
from pipeline.model.shown import FRAME_SIZE
from pipeline.model.words_model import WordsModel, load_words
from pipeline.model.words_network import (
    CHANNELS,
    FRAMES,
    MERGE,
    PATCH,
    WordsNetwork,
    place_features,
)

BODY_TOKENS = 1 + FRAMES // 2 * (SIDE // PATCH // MERGE) ** 2 + FRAMES
INPUT = ModelInput("any", None, "exact", (240, 160), 4, "any", "any")


@pytest.fixture
def network() -> WordsNetwork:
    return tiny_words().eval()


def random_places(generator: torch.Generator, *shape: int) -> Tensor:
    """(*shape, 14) places of bodies that are seen."""
    u = torch.rand(*shape, 14, generator=generator)
    left, top = 0.6 * WIDTH * u[..., 1], 0.6 * HEIGHT * u[..., 3]
    right, bottom = left + 10 + 0.2 * WIDTH * u[..., 2], top + 10 + 0.2 * HEIGHT * u[..., 4]
    x, y = (left + right) / 2, (top + bottom) / 2
    area = 0.7 * (right - left) * (bottom - top)
    rest = [20 * u[..., 8] - 10, 20 * u[..., 9] - 10, *(u[..., k].round() for k in range(10, 14))]
    return torch.stack([torch.ones_like(x), left, right, top, bottom, x, y, area, *rest], -1)


def bodies(count: int, colours: bool, batch: int = 1, seed: int = 0) -> tuple[Tensor, Tensor, Tensor]:
    """Crops, places and numbers of bodies."""
    generator = torch.Generator().manual_seed(seed)
    channels = 4 if colours else 3
    crops = torch.randint(-127, 128, (batch, count, FRAMES, channels, SIDE, SIDE), generator=generator).to(torch.int8)
    numbers = torch.stack([torch.randperm(d.PLACES, generator=generator)[:count].sort().values for _ in range(batch)])
    return crops, random_places(generator, batch, count, FRAMES), numbers


def decided(length: int, seed: int = 1) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Arrays (1, L) of decisions: token, share, ask, of, position."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(low: int, high: int) -> Tensor:
        return torch.randint(low, high, (1, length), generator=generator)

    share = 2 * torch.rand(1, length, generator=generator) - 1
    of = drawn(0, 2) * drawn(d.PLACE0, d.SHAPE0)
    return drawn(1, d.TOKENS), share, drawn(1, d.ASKS), of, d.ANSWER_AT + torch.arange(length)[None]


def states(
    network: WordsNetwork, prompt: tuple[Tensor, Tensor], answer: tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
) -> Tensor:
    """(1, L, width) states of the decisions after the prompt."""
    token, share, ask, of, position = answer
    x = torch.cat([prompt[0], network.embed_decisions(token, share, ask, of)], 1)
    where = torch.cat([prompt[1], position.expand(3, -1, -1)], 2)
    return network.language_states(x, where)[:, prompt[0].shape[1] :]


@pytest.mark.parametrize("size", [(SIDE, SIDE), FRAME_SIZE])
@torch.no_grad()
def test_the_vision_tower_equals_that_of_transformers_on_the_same_patches(
    network: WordsNetwork, size: tuple[int, int]
) -> None:
    width, height = size
    clips, pairs, rows, columns = 2, 2, height // PATCH, width // PATCH
    pictures = 2 * torch.rand(clips, 2 * pairs, len(CHANNELS), height, width) - 1
    # As the processor of Qwen2-VL cuts patches: pair of frames, blocks of 2 x 2, then channel, frame, row, column.
    cut = pictures.reshape(
        clips, pairs, 2, len(CHANNELS), rows // MERGE, MERGE, PATCH, columns // MERGE, MERGE, PATCH
    ).permute(0, 1, 4, 7, 5, 8, 3, 2, 6, 9)
    patches = cut.reshape(clips * pairs * rows * columns, -1)
    grid = torch.tensor([[pairs, rows, columns]] * clips)
    theirs = network.qwen.model.visual(patches, grid_thw=grid).pooler_output
    ours = network.encode_pictures(pictures)
    torch.testing.assert_close(ours.flatten(0, 1), theirs, rtol=0, atol=1e-5)
    assert theirs.std() > 1e-3


@torch.no_grad()
def test_later_decisions_do_not_influence_earlier_states(network: WordsNetwork) -> None:
    prompt = network.bodies_prompt(*_of(bodies(2, False), False))
    first, second = decided(9), decided(9, seed=2)
    mixed = [torch.cat([a[:, :5], b[:, 5:]], 1) for a, b in zip(first, second, strict=True)]
    one, other = states(network, prompt, first), states(network, prompt, tuple(mixed))  # type: ignore[arg-type]
    torch.testing.assert_close(one[:, :5], other[:, :5], rtol=0, atol=1e-6)
    assert ((one[:, 5:] - other[:, 5:]).abs().amax(-1) > 1e-3).all()


@pytest.mark.parametrize("colours", [False, True])
@torch.no_grad()
def test_the_first_body_influences_the_last_state(network: WordsNetwork, colours: bool) -> None:
    crops, places, numbers = bodies(3, colours)
    answer = decided(6)
    before = states(network, network.bodies_prompt(crops, colours, places, numbers), answer)
    other_crops, other_places = crops.clone(), places.clone()
    other_crops[:, 0] = 0
    other_places[:, 0, :, 1:8] *= 0.5
    for changed in ((other_crops, places), (crops, other_places)):
        after = states(network, network.bodies_prompt(changed[0], colours, changed[1], numbers), answer)
        assert (after[:, -1] - before[:, -1]).abs().max() > 1e-5


@pytest.mark.parametrize("frame", [False, True])
@torch.no_grad()
def test_a_cached_decision_equals_an_uncached_one(network: WordsNetwork, frame: bool) -> None:
    if frame:
        frames = torch.randint(-127, 128, (1, FRAMES, 2, FRAME_SIZE[1], FRAME_SIZE[0])).to(torch.int8)
        prompt = network.frame_prompt(frames, False)
    else:
        prompt = network.bodies_prompt(*_of(bodies(2, True), True))
    answer = decided(7)
    whole = states(network, prompt, answer)
    cache = DynamicCache(config=network.qwen.config.get_text_config())
    network.language_states(*prompt, cache)
    for k in range(7):
        token, share, ask, of, position = (a[:, k : k + 1] for a in answer)
        state = network.language_states(
            network.embed_decisions(token, share, ask, of), position.expand(3, -1, -1), cache
        )
        torch.testing.assert_close(state[:, 0], whole[:, k], rtol=0, atol=1e-5)


@torch.no_grad()
def test_examples_of_a_batch_do_not_influence_each_other(network: WordsNetwork) -> None:
    crops, places, numbers = bodies(2, False, batch=3)
    together, where = network.bodies_prompt(crops, False, places, numbers)
    run = network.language_states(together, where)
    for k in range(3):
        alone, at = network.bodies_prompt(crops[k : k + 1], False, places[k : k + 1], numbers[k : k + 1])
        assert torch.equal(at[:, 0], where[:, k])
        torch.testing.assert_close(network.language_states(alone, at)[0], run[k], rtol=0, atol=1e-5)


def test_a_checkpoint_gives_the_states_of_its_rounded_weights_and_the_record_of_its_input(
    tmp_path: Path, network: WordsNetwork
) -> None:
    WordsModel(network, INPUT).save(tmp_path)
    loaded = load_words(str(tmp_path))
    assert loaded.input == INPUT
    assert loaded.name == str(tmp_path)
    assert not loaded.model.training
    torch.manual_seed(0)
    rounded = WordsNetwork(TINY).eval()
    before = rounded.state_dict()
    rounded.load_state_dict({k: v.half().float() for k, v in before.items()})
    assert {k: v.dtype for k, v in loaded.model.state_dict().items()} == {k: v.dtype for k, v in before.items()}
    shown = _of(bodies(2, False), False)
    with torch.no_grad():
        wanted, found = (states(m, m.bodies_prompt(*shown), decided(6)) for m in (rounded, loaded.model))
    torch.testing.assert_close(found, wanted, rtol=0, atol=1e-6)


def test_saving_a_model_changes_its_weights_by_rounding_at_most_and_its_rotary_angles_not_at_all(
    tmp_path: Path, network: WordsNetwork
) -> None:
    weights = {k: v.detach().clone() for k, v in network.named_parameters()}
    buffers = {k: v.clone() for k, v in network.named_buffers()}
    WordsModel(network).save(tmp_path)
    for name, value in network.named_parameters():
        torch.testing.assert_close(value.detach(), weights[name], rtol=1e-3, atol=1e-6, msg=name)
    for name, angles in network.named_buffers():
        torch.testing.assert_close(angles, buffers[name], rtol=0, atol=0, msg=name)


def test_a_saved_checkpoint_that_is_loaded_and_saved_again_is_the_same_file(
    tmp_path: Path, network: WordsNetwork
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    WordsModel(network).save(first)
    load_words(str(first)).save(second)
    for name in ("model.safetensors", "config.json"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_a_folder_without_a_words_model_is_refused_in_one_sentence(tmp_path: Path, network: WordsNetwork) -> None:
    with pytest.raises(ModelError, match=r"has no words model .*; valid: models/words"):
        load_words(str(tmp_path))
    WordsModel(network).save(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"no weights")
    with pytest.raises(ModelError, match="has no words model"):
        load_words(str(tmp_path))
    with pytest.raises(ModelError, match="10 frames a clip; 8"):
        load_words(str(tmp_path), frames=8)


@torch.no_grad()
def test_a_prompt_with_colours_ignores_measured_flow(network: WordsNetwork) -> None:
    for colours in (True, False):
        crops, places, numbers = bodies(2, colours)
        other = places.clone()
        other[..., 8:10] = -3 * other[..., 8:10] + 1
        one, _ = network.bodies_prompt(crops, colours, places, numbers)
        two, _ = network.bodies_prompt(crops, colours, other, numbers)
        assert torch.equal(one, two) == colours


@torch.no_grad()
def test_colours_and_flow_are_shown_in_channels_of_their_own(network: WordsNetwork) -> None:
    shown = {}
    for colours, count in ((True, 3), (False, 2)):
        shown[colours] = network.as_pictures(torch.full((1, count + 1, 4, 4), 127, dtype=torch.int8), colours)[
            0, :, 0, 0
        ]
    assert shown[True].tolist() == [1, 1, 1, 0, 0, 1]
    assert shown[False].tolist() == [0, 0, 0, 1, 1, 1]
    assert network.as_pictures(torch.full((1, 2, 4, 4), -127, dtype=torch.int8), False)[0, :, 0, 0].tolist() == [
        *[0, 0, 0],
        *[-1, -1, 0],
    ]


@torch.no_grad()
def test_other_places_of_the_bodies_change_names_and_positions_only(network: WordsNetwork) -> None:
    crops, places, _ = bodies(2, False)
    low, high = torch.tensor([[0, 1]]), torch.tensor([[2, 7]])
    (one, at), (two, where) = (network.bodies_prompt(crops, False, places, n) for n in (low, high))
    assert one.shape == two.shape == (1, 2 + 2 * BODY_TOKENS, TINY.width)
    assert torch.equal(one[:, :2], two[:, :2]) and torch.equal(at[..., :2], where[..., :2])
    for body in range(2):
        part = slice(2 + body * BODY_TOKENS, 2 + (body + 1) * BODY_TOKENS)
        renamed = network.token_embedding(d.PLACE0 + high[:, body]) - network.token_embedding(d.PLACE0 + low[:, body])
        torch.testing.assert_close(two[:, part] - one[:, part], renamed[:, None].expand(-1, BODY_TOKENS, -1))
        moved = d.TOKENS_OF_BODY * int(high[0, body] - low[0, body])
        assert torch.equal(where[..., part] - at[..., part], torch.full((3, 1, BODY_TOKENS), moved))


@torch.no_grad()
def test_positions_of_head_bodies_and_answer_are_disjoint(network: WordsNetwork) -> None:
    crops, places, numbers = bodies(d.PLACES, False)
    _, where = network.bodies_prompt(crops, False, places, numbers)
    owner: dict[int, int] = {}
    for k in range(where.shape[2]):
        body = -1 if k < 2 else (k - 2) // BODY_TOKENS
        for position in where[:, 0, k].tolist():
            assert owner.setdefault(position, body) == body
    assert max(owner) < d.ANSWER_AT
    frames = torch.zeros(1, FRAMES, 3, FRAME_SIZE[1], FRAME_SIZE[0], dtype=torch.int8)
    _, of_frame = network.frame_prompt(frames, True)
    assert of_frame[:, :, 2:].min() >= 2 and of_frame.max() < d.ANSWER_AT
    one_each = {tuple(of_frame[:, 0, k].tolist()) for k in range(of_frame.shape[2])}
    assert len(one_each) == of_frame.shape[2]


@torch.no_grad()
def test_what_is_not_seen_leaves_no_trace_but_that_it_is_not_seen(network: WordsNetwork) -> None:
    crops, places, numbers = bodies(2, False)
    places[:, 1, 3] = 0
    other = places.clone()
    other[:, 1, 3, 1:] = 7.0
    one, _ = network.bodies_prompt(crops, False, places, numbers)
    two, _ = network.bodies_prompt(crops, False, other, numbers)
    changed = (one != two).any(-1)[0]
    assert not changed.any()


def test_features_of_places_are_finite_for_the_smallest_and_the_largest_body() -> None:
    small = torch.tensor([1.0, 5, 6, 7, 8, 5.5, 7.5, 1, 0, 0, 0, 0, 0, 0])
    large = torch.tensor([1.0, 0, WIDTH, 0, HEIGHT, WIDTH / 2, HEIGHT / 2, WIDTH * HEIGHT, 300, -300, 1, 1, 1, 1])
    for places in (small, large, torch.zeros(14)):
        features = place_features(places.expand(2, FRAMES, 14), torch.ones(2, 1))
        assert features.isfinite().all()
        assert features.abs().max() <= 8


def _of(shown: tuple[Tensor, Tensor, Tensor], colours: bool) -> tuple[Tensor, bool, Tensor, Tensor]:
    """The arguments of `bodies_prompt`."""
    crops, places, numbers = shown
    return crops, colours, places, numbers
