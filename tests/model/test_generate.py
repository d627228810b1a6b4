from collections.abc import Iterator

import numpy as np
import pytest
import torch
from random_walk import random_walk
from scipy.special import softmax
from small_base import LAYOUT, SIZE, exact_base, random_clips, small_base

from pipeline.model.base import Base
from pipeline.model.constrained_decoding import GrammarState, Trie
from pipeline.model.forward import rotary_positions
from pipeline.model.generate import at_quantile, generate
from pipeline.model.language.completion import completion_grammar, read_completion
from pipeline.model.language.grammar import GrammarError, Number, split
from pipeline.model.patches import pack_video
from pipeline.model.sampling import Completed, Sampling, batches

BASE = small_base()
EXACT = exact_base()


@torch.no_grad()
def logits_of(base: Base, clip: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Next-token logits (L, V) after each of the ids, in one pass without a cache."""
    out = base.model(
        input_ids=torch.as_tensor(ids.astype(np.int64))[None],
        pixel_values_videos=pack_video(torch.as_tensor(clip[None]), base.layout),
        video_grid_thw=torch.tensor([base.layout.grid]),
        position_ids=rotary_positions(base, torch.as_tensor(ids.astype(np.int64))[None]),
        use_cache=False,
    )
    return out.logits[0].double().numpy()


def told(text: str, reasoning: bool, logits: np.ndarray) -> list[tuple[list[int], int, np.ndarray]]:
    """Each choice of a completion: the allowed tokens, which was taken, and their log-probabilities."""
    tokens = BASE.codec.encode(text, reasoning, 1.0)
    state = GrammarState(completion_grammar(reasoning, 1.0), BASE.codec, BASE.tries)
    at = tokens.prompt_length + len(state.forced())
    choices = []
    while not state.finished:
        scores = logits[at - 1][state.allowed]
        log_p = scores - np.log(np.exp(scores - scores.max()).sum()) - scores.max()
        token = int(tokens.ids[at])
        choices.append((state.allowed, state.allowed.index(token), log_p))
        state.take(token)
        at += 1 + len(state.forced())
    return choices


def recomputed(clip: np.ndarray, answer: Completed, reasoning: bool) -> list[tuple[list[int], int, np.ndarray]]:
    ids = BASE.codec.encode(answer.text, reasoning, 1.0).ids
    return told(answer.text, reasoning, logits_of(BASE, clip, ids))


@pytest.mark.parametrize("reasoning", [True, False])
def test_greedy_takes_the_likeliest_allowed_token_as_without_a_cache(rng: np.random.Generator, reasoning: bool) -> None:
    clips = random_clips(rng, 2)
    answers = generate(BASE, clips, Sampling(reasoning=reasoning, numbers="tokens"), [1, 2])
    for clip, (answer,) in zip(clips, answers, strict=True):
        for _, taken, log_p in recomputed(clip, answer, reasoning):
            assert log_p[taken] >= log_p.max() - 1e-4


def quantiles_of_numbers(clip: np.ndarray, text: str) -> Iterator[tuple[float, float]]:
    """For each number of a completion, the probabilities of less and of no more than it, without a cache."""
    tokens = EXACT.codec.encode(text, True, 1.0)
    logits = logits_of(EXACT, clip, tokens.ids)
    state = GrammarState(completion_grammar(True, 1.0), EXACT.codec, EXACT.tries)
    at = tokens.prompt_length + len(state.forced())
    below, share = 0.0, 1.0  # of what is less than the tokens so far, and of what they begin
    while not state.finished:
        p = softmax(logits[at - 1][state.allowed])
        token, numeric, written = int(tokens.ids[at]), state.numeric, state.text
        taken = state.allowed.index(token)
        state.take(token)
        at += 1 + len(state.forced())
        if numeric:
            below, share = below + share * p[:taken].sum(), share * p[taken]
            if state.text != written:  # the number is whole
                yield below, below + share
                below, share = 0.0, 1.0


@pytest.mark.parametrize(
    ("sampling", "low", "high"),
    [
        (Sampling(), 0.5, 0.5),
        (Sampling(3, 1.0, middle=0.4), 0.3, 0.7),
        (Sampling(3, 1.0, middle=1.0), 0.0, 1.0),
    ],
)
def test_numbers_are_medians_or_in_the_middle(
    rng: np.random.Generator, sampling: Sampling, low: float, high: float
) -> None:
    clips, found = random_clips(rng, 2), []
    for clip, answers in zip(clips, generate(EXACT, clips, sampling, [1, 2]), strict=True):
        found += [numbers for answer in answers for numbers in quantiles_of_numbers(clip, answer.text)]
    below, up_to = np.array(found).T
    assert len(found) > 20
    assert (below <= high + 1e-9).all() and (up_to >= low - 1e-9).all()
    if high > low:  # and all over it
        middle = (below + up_to) / 2
        assert (middle < low + 0.3 * (high - low)).any() and (middle > high - 0.3 * (high - low)).any()


Weighed = list[tuple[float, "Weighed | float"]]


def weighed(trie: Trie, rng: np.random.Generator) -> Weighed:
    """The tree of a number's tokens, each with a probability at random among those that stand beside it."""
    shares = softmax(rng.normal(0, 3, len(trie)))
    nodes = [float(n) if isinstance(n, str) else weighed(n, rng) for n in trie.values()]
    return list(zip(shares.tolist(), nodes, strict=True))


def leaves(tree: Weighed, p: float = 1.0) -> list[tuple[float, float]]:
    """(number, its probability), in the tree's order."""
    below = [[(node, p * q)] if isinstance(node, float) else leaves(node, p * q) for q, node in tree]
    return [leaf for part in below for leaf in part]


@pytest.mark.parametrize("number", [Number(3, -9.999, 9.999), Number(2, 0.05, 9.99), Number(2, -89, 89)])
def test_a_quantile_token_by_token_is_that_of_the_number(rng: np.random.Generator, number: Number) -> None:
    for wanted in rng.uniform(0, 1, 10):
        tree = weighed(BASE.tries.of(number), rng)
        numbers, p = np.array(leaves(tree)).T
        assert (np.diff(numbers) > 0).all()
        node: Weighed | float = tree
        quantile = float(wanted)
        while not isinstance(node, float):
            pick, quantile = at_quantile(np.array([q for q, _ in node]), quantile)
            node = node[pick][1]
        assert p[numbers < node].sum() - 1e-9 <= wanted <= p[numbers <= node].sum() + 1e-9


@pytest.mark.parametrize("temperature", [0.0, 1.5])
def test_the_log_probability_is_that_of_its_choices_without_a_cache(
    rng: np.random.Generator, temperature: float
) -> None:
    clips = random_clips(rng, 2)
    sampling = Sampling(samples=1 if temperature == 0 else 3, temperature=temperature, top_p=0.95)
    for clip, answers in zip(clips, generate(BASE, clips, sampling, [1, 2]), strict=True):
        for answer in answers:
            expected = sum(log_p[taken] for _, taken, log_p in recomputed(clip, answer, True))
            assert answer.log_probability == pytest.approx(expected, abs=0.02)


def test_samples_are_among_the_nucleus(rng: np.random.Generator) -> None:
    clips = random_clips(rng, 1)
    sampling = Sampling(samples=4, temperature=1.0, top_p=0.5, reasoning=False, numbers="tokens")
    for answer in generate(BASE, clips, sampling, [7])[0]:
        for _, taken, log_p in recomputed(clips[0], answer, False):
            p = np.exp(log_p)
            assert p[p > p[taken] + 1e-6].sum() <= 0.5 + 1e-4


def test_samples_repeat_by_their_seed_whatever_else_is_in_the_batch(rng: np.random.Generator) -> None:
    clips = random_clips(rng, 3)
    sampling = Sampling(samples=3, temperature=1.0, top_p=0.9, reasoning=False)
    together = generate(EXACT, clips, sampling, [5, 6, 7])
    again = generate(EXACT, clips[1:2], sampling, [6])
    assert [a.text for a in again[0]] == [a.text for a in together[1]]
    np.testing.assert_allclose(
        [a.log_probability for a in again[0]], [a.log_probability for a in together[1]], atol=0.02
    )
    assert len({a.text for answers in together for a in answers}) > 3
    other = generate(EXACT, clips[1:2], sampling, [8])
    assert [a.text for a in other[0]] != [a.text for a in together[1]]


def test_fewer_samples_are_the_first_of_more(rng: np.random.Generator) -> None:
    clips = random_clips(rng, 1)
    few, many = (generate(EXACT, clips, Sampling(n, 1.0, reasoning=False), [3])[0] for n in (2, 4))
    assert [a.text for a in few] == [a.text for a in many[:2]]


@pytest.mark.parametrize("reasoning", [True, False])
def test_every_answer_of_an_untrained_model_parses(rng: np.random.Generator, reasoning: bool) -> None:
    base = small_base(int(rng.integers(1000)))
    sampling = Sampling(samples=4, temperature=3.0, top_p=1.0, reasoning=reasoning)
    for answers in generate(base, random_clips(rng, 2), sampling, [1, 2]):
        for answer in answers:
            completion = read_completion(answer.text)
            assert bool(completion.think) == reasoning
            assert completion.scene.objects
            split(completion_grammar(reasoning, 1.0), answer.text)


def test_the_clip_changes_the_answer(rng: np.random.Generator) -> None:
    answers = generate(BASE, random_clips(rng, 4), Sampling(reasoning=False), [0] * 4)
    assert len({a[0].log_probability for a in answers}) > 1


def test_batches_cover_the_clips_once_and_hold_no_more_than_fits() -> None:
    for clips, samples, size in ((10, 8, 32), (3, 50, 32), (7, 1, 4)):
        parts = list(batches(clips, samples, size))
        assert [c for part in parts for c in part] == list(range(clips))
        assert all(len(part) == 1 or len(part) * samples <= size for part in parts)


def test_the_longest_answer_fits_even_letter_by_letter(rng: np.random.Generator) -> None:
    longest = max((random_walk(rng, completion_grammar(True, 1.0), end=0.0)[0] for _ in range(200)), key=len)
    assert len(longest) < Sampling().most_tokens
    assert len(BASE.codec.encode(longest, True, 1.0).ids) < Sampling().most_tokens


def test_the_state_knows_only_the_grammars_texts() -> None:
    with pytest.raises(GrammarError):
        BASE.codec.encode("<think>\nno", True, 1.0)
    assert LAYOUT.tokens == BASE.codec.prompt_ids.count(BASE.codec.video_token_id)
    assert BASE.model.config.text_config.hidden_size == SIZE.hidden
