"""Answers of a words model that has learned nothing: whatever it prefers, they are texts that can be read."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_words import tiny_words
from torch import Tensor, nn

from pipeline.errors import ModelError
from pipeline.model import decisions as d
from pipeline.model.deciding import decide
from pipeline.model.fields import NOTHING
from pipeline.model.instances import HEIGHT, WIDTH
from pipeline.model.language.completion import MAX_OBJECTS, read_completion
from pipeline.model.sampling import Sampling
from pipeline.model.shown import SeenBodies, SeenFrames, flow_frames, most_seen, rgb_frames, seen_bodies
from pipeline.model.words_model import WordsModel, bodies_said, prompt_of, write_answers
from pipeline.model.words_network import FRAMES, WordsNetwork
from pipeline.scene.scene import BASIC_SHAPES

DRAWN = Sampling(samples=4, temperature=1.0, top_p=1.0, middle=1.0)


@pytest.fixture
def network() -> WordsNetwork:
    return tiny_words().eval()


def masks_of(bodies: int) -> np.ndarray:
    """(T, HEIGHT, WIDTH) with squares that move to the right; of a later body fewer frames."""
    masks = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    for k in range(bodies):
        for t in range(FRAMES - k // 2):
            masks[t, 10 + 35 * (k % 4) :, 10 + 70 * (k // 4) + 3 * t :][:20, :20] = k + 1
    return masks


def flow_of(masks: np.ndarray) -> np.ndarray:
    return np.stack([(masks > 0).astype(np.float32), np.zeros(masks.shape, np.float32)], -1)


def colours() -> np.ndarray:
    return np.random.default_rng(0).integers(256, size=(FRAMES, HEIGHT, WIDTH, 3), dtype=np.uint8)


def seen_of(bodies: int, rgb: bool, prior: np.ndarray | None = None) -> SeenBodies:
    masks = masks_of(bodies)
    return seen_bodies(masks, flow_of(masks), colours() if rgb else None, prior)


def seen_frames(rgb: bool) -> SeenFrames:
    return rgb_frames(colours()) if rgb else flow_frames(flow_of(masks_of(3)))


class Wants(nn.Module):
    """In place of the head of tokens: the same preference, whatever is seen."""

    def __init__(self, *tokens: int) -> None:
        super().__init__()
        self.logits = torch.zeros(d.TOKENS)
        self.logits[list(tokens)] = 30.0

    def forward(self, states: Tensor) -> Tensor:
        return self.logits.expand(*states.shape[:-1], -1)


SHAPES = tuple(d.SHAPE0 + k for k in range(NOTHING))


def assert_readable(texts: list[str], reasoning: bool, most: int) -> None:
    for text in texts:
        read = read_completion(text)
        assert 1 <= len(read.scene.objects) <= most
        assert bool(read.think) == reasoning
        if reasoning:
            count, shapes = read.think.splitlines()[0].rstrip(".").split(": ")
            assert int(count.split()[0]) == len(read.scene.objects)
            assert shapes.split(", ") == list(read.scene.shapes)


@pytest.mark.parametrize("reasoning", [True, False])
@pytest.mark.parametrize(("bodies", "rgb"), [(1, True), (3, False), (8, False), (11, True)])
def test_answers_about_bodies_are_read(network: WordsNetwork, bodies: int, rgb: bool, reasoning: bool) -> None:
    seen = seen_of(bodies, rgb)
    assert len(seen.instances) == bodies
    for sampling in (Sampling(reasoning=reasoning), replace(DRAWN, reasoning=reasoning)):
        answers = write_answers(WordsModel(network), seen, sampling, 1)
        assert len(answers) == sampling.samples
        assert_readable([a.text for a in answers], reasoning, min(bodies, d.PLACES))
        assert all(np.isfinite(a.log_probability) and a.log_probability < 0 for a in answers)


@pytest.mark.parametrize(("rgb", "reasoning"), [(False, True), (True, False)])
def test_answers_about_frames_are_read(network: WordsNetwork, rgb: bool, reasoning: bool) -> None:
    seen = seen_frames(rgb)
    assert seen.colours == rgb
    for sampling in (Sampling(reasoning=reasoning), replace(DRAWN, reasoning=reasoning)):
        answers = write_answers(WordsModel(network), seen, sampling, 1)
        assert len(answers) == sampling.samples
        assert_readable([a.text for a in answers], reasoning, MAX_OBJECTS)


@pytest.mark.parametrize("reasoning", [True, False])
@pytest.mark.parametrize("bodies", [6, 8])
def test_an_answer_that_takes_everything_for_a_body_is_read(
    network: WordsNetwork, bodies: int, reasoning: bool
) -> None:
    network.qwen.lm_head = Wants(*SHAPES, d.AT)  # type: ignore[assignment]
    (answer,) = write_answers(WordsModel(network), seen_of(bodies, False), Sampling(reasoning=reasoning), 1)
    assert_readable([answer.text], reasoning, bodies)


@pytest.mark.parametrize("reasoning", [True, False])
def test_an_answer_that_would_be_without_a_body_has_one(network: WordsNetwork, reasoning: bool) -> None:
    network.qwen.lm_head = Wants(d.SHAPE0 + NOTHING)  # type: ignore[assignment]
    for seen in (seen_of(3, True), seen_frames(False)):
        answers = write_answers(WordsModel(network), seen, replace(DRAWN, reasoning=reasoning), 1)
        assert_readable([a.text for a in answers], reasoning, 1)


def test_an_answer_that_would_tell_events_without_end_stops(network: WordsNetwork) -> None:
    network.qwen.lm_head = Wants(d.AT, *SHAPES, d.KIND0)  # type: ignore[assignment]
    (answer,) = write_answers(WordsModel(network), seen_of(3, False), Sampling(), 1)
    lines = read_completion(answer.text).think.splitlines()[1:]
    assert len(lines) == d.MOST_EVENTS
    times = [float(line.removeprefix("t=").split("s")[0]) for line in lines]
    assert times == sorted(times)
    for line in lines:
        who, whom = line.rstrip(".").split(": object ")[1].split(" hits object ")
        assert who != whom


@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_times_of_events_lie_in_the_clip(network: WordsNetwork, seconds: float) -> None:
    network.qwen.lm_head = Wants(d.AT, *SHAPES)  # type: ignore[assignment]
    sampling = replace(DRAWN, seconds=seconds)
    times = [
        float(line.removeprefix("t=").split("s")[0])
        for answer in write_answers(WordsModel(network), seen_of(2, False), sampling, 1)
        for line in read_completion(answer.text).think.splitlines()[1:]
    ]
    assert len(times) == 4 * d.MOST_EVENTS
    assert min(times) >= 0
    assert max(times) <= seconds
    assert max(times) > seconds / 2


@pytest.mark.parametrize("frame", [False, True])
def test_one_seed_gives_the_same_texts(network: WordsNetwork, frame: bool) -> None:
    seen = seen_frames(True) if frame else seen_of(3, False)
    sampling = DRAWN

    def texts(seed: int) -> list[str]:
        return [a.text for a in write_answers(WordsModel(network), seen, sampling, seed)]

    torch.manual_seed(1)
    first = texts(7)
    torch.manual_seed(2)
    assert texts(7) == first
    assert texts(8) != first
    assert len(set(first)) == 4


def test_the_likeliest_answer_depends_on_no_seed(network: WordsNetwork) -> None:
    answers = [write_answers(WordsModel(network), seen_of(3, False), Sampling(), seed) for seed in (1, 2)]
    assert answers[0] == answers[1]


@pytest.mark.parametrize("reasoning", [True, False])
def test_a_shape_prior_that_is_sure_decides_the_shapes(network: WordsNetwork, reasoning: bool) -> None:
    sure = [2, 0, 1, 1]
    sampling = replace(DRAWN, reasoning=reasoning)
    prior = np.eye(NOTHING)[sure]
    seen = seen_of(4, False, prior)
    prompt, places = prompt_of(network, seen)
    with_prior, _ = decide(network, prompt, places, False, sampling, 3, prior)
    without, _ = decide(network, prompt, places, False, sampling, 3)
    for said in with_prior:
        assert all(shape in (wanted, NOTHING) for shape, wanted in zip(said.shapes, sure, strict=True))
    assert any(s not in (w, NOTHING) for said in without for s, w in zip(said.shapes, sure, strict=True))
    network.qwen.lm_head = Wants(*SHAPES)  # type: ignore[assignment]
    for answer in write_answers(WordsModel(network), seen, sampling, 3):
        assert list(read_completion(answer.text).scene.shapes) == [BASIC_SHAPES[k] for k in sure]


def test_a_shape_prior_leaves_the_share_of_nothing_as_it_is(network: WordsNetwork) -> None:
    network.qwen.lm_head = Wants(d.SHAPE0 + NOTHING)  # type: ignore[assignment]
    seen = seen_of(3, False, np.eye(NOTHING)[[2, 0, 1]])
    prompt, places = prompt_of(network, seen)
    (said,), _ = decide(network, prompt, places, False, Sampling(), 1, seen.instances.shape_prior)
    assert said.shapes == [NOTHING, NOTHING, 1]


def test_draws_from_the_smallest_nucleus_are_the_likeliest_answer(network: WordsNetwork) -> None:
    prompt, places = prompt_of(network, seen_of(3, False))
    (likeliest,), _ = decide(network, prompt, places, False, Sampling(), 1)
    drawn, _ = decide(network, prompt, places, False, Sampling(3, temperature=1.0, top_p=1e-6, middle=0.0), 1)
    for said in drawn:
        assert said.shapes == likeliest.shapes
        assert [e[1:] for e in said.events] == [e[1:] for e in likeliest.events]
        assert [e[0] for e in said.events] == pytest.approx([e[0] for e in likeliest.events], abs=1e-4)
        assert said.scene == pytest.approx(likeliest.scene, abs=1e-3)


def test_the_lowest_temperature_draws_the_likeliest_shapes(network: WordsNetwork) -> None:
    prompt, places = prompt_of(network, seen_of(2, False))
    (likeliest,), _ = decide(network, prompt, places, False, Sampling(), 1)
    drawn, _ = decide(network, prompt, places, False, Sampling(2, temperature=1e-4, middle=0.0), 1)
    assert [said.shapes for said in drawn] == [likeliest.shapes] * 2


def test_samples_decided_together_equal_the_one_that_is_decided_alone(network: WordsNetwork) -> None:
    prompt, places = prompt_of(network, seen_of(2, False))
    network.qwen.lm_head = Wants(d.AT, *SHAPES)  # type: ignore[assignment]
    (alone,), _ = decide(network, prompt, places, False, Sampling(), 1)
    together, _ = decide(network, prompt, places, False, Sampling(samples=3), 1)
    for said in together:
        assert (said.shapes, [e[1:] for e in said.events]) == (alone.shapes, [e[1:] for e in alone.events])
        assert np.allclose(said.values, alone.values, atol=1e-3)


def test_a_clip_without_bodies_is_refused(network: WordsNetwork) -> None:
    masks = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    for frames in (None, colours()):
        seen = seen_bodies(masks, flow_of(masks), frames)
        with pytest.raises(ModelError, match="the masks of this clip have none"):
            write_answers(WordsModel(network), seen, Sampling(), 1)


def test_of_more_bodies_than_places_those_seen_longest_count() -> None:
    prior = np.tile(np.arange(1.0, 12.0)[:, None], (1, NOTHING))
    masks = masks_of(11)
    masks[3:][masks[3:] == 2] = 0  # the second body is seen in three frames alone, the last ones in five and six
    seen = seen_bodies(masks, flow_of(masks), colours(), prior)
    kept = most_seen(seen, d.PLACES)
    assert kept.instances.ids.tolist() == [1, 3, 4, 5, 6, 7, 8, 9]
    assert kept.colours is not None and seen.colours is not None
    assert np.array_equal(kept.colours, seen.colours[kept.instances.ids - 1])
    assert kept.instances.shape_prior is not None
    assert kept.instances.shape_prior[:, 0].tolist() == kept.instances.ids.tolist()
    assert np.array_equal(most_seen(kept, d.PLACES).instances.ids, kept.instances.ids)


def test_bodies_that_are_none_are_left_out_and_the_others_numbered_in_their_order() -> None:
    said = d.Said([NOTHING, 2, NOTHING, 0])
    assert bodies_said(said) == [1, 3]
