from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from small_base import exact_base, random_clips, small_base

from pipeline.model.base import Base
from pipeline.model.generate import generate
from pipeline.model.language.completion import read_completion
from pipeline.model.language.grammar import GrammarError
from pipeline.model.likelihood import constrained_tokens, log_probabilities
from pipeline.model.preference import (
    Pair,
    dpo_loss,
    draw_answers,
    implicit_margin,
    pairs_of,
    prefer,
    rank_pairs,
)
from pipeline.model.sampling import Completed, Sampling
from pipeline.model.training_plan import TrainingPlan

BASE = small_base()
DRAWN = Sampling(4, 1.0, 1.0, reasoning=True, numbers="tokens")


def log_p(base: Base, text: str, clip: np.ndarray, reasoning: bool = True) -> float:
    with torch.no_grad():
        written = constrained_tokens(base, text, reasoning, 1.0)
        return log_probabilities(base, [written], torch.as_tensor(clip[None]))[0].item()


# ---- probability under the grammar


@pytest.mark.parametrize("reasoning", [True, False])
def test_the_probability_of_an_answer_is_that_with_which_it_was_drawn(
    rng: np.random.Generator, reasoning: bool
) -> None:
    clips = random_clips(rng, 2)
    drawn = Sampling(2, 1.0, 1.0, reasoning, numbers="tokens")
    for clip, answers in zip(clips, generate(BASE, clips, drawn, [1, 2]), strict=True):
        for answer in answers:
            assert log_p(BASE, answer.text, clip, reasoning) == pytest.approx(answer.log_probability, abs=0.02)


def test_an_answer_has_the_same_probability_beside_longer_ones(rng: np.random.Generator) -> None:
    clips = random_clips(rng, 3)
    texts = [answers[0].text for answers in generate(BASE, clips, DRAWN, [1, 2, 3])]
    with torch.no_grad():
        written = [constrained_tokens(BASE, text, True, 1.0) for text in texts]
        together = log_probabilities(BASE, written, torch.as_tensor(clips))
    alone = [log_p(BASE, text, clip) for text, clip in zip(texts, clips, strict=True)]
    np.testing.assert_allclose(together.numpy(), alone, atol=0.02)


def test_what_the_grammar_forces_is_no_choice(rng: np.random.Generator) -> None:
    (answers,) = generate(BASE, random_clips(rng, 1), DRAWN, [5])
    for answer in answers:
        written = constrained_tokens(BASE, answer.text, True, 1.0)
        assert all(len(allowed) > 1 for allowed in written.allowed)
        assert all(int(written.ids[at]) in allowed for at, allowed in zip(written.free, written.allowed, strict=True))
    with pytest.raises(GrammarError):
        constrained_tokens(BASE, "<think>\nno", True, 1.0)


# ---- the loss


def test_the_loss_of_equal_log_probabilities_is_log_2(rng: np.random.Generator) -> None:
    better, worse = torch.as_tensor(rng.normal(size=(2, 5)))
    margin = implicit_margin(better, worse, better, worse, beta=0.1)
    assert dpo_loss(margin).item() == pytest.approx(np.log(2))


def test_its_gradient_raises_the_better_answer_and_lowers_the_worse_one_by_as_much(rng: np.random.Generator) -> None:
    sides = [torch.as_tensor(rng.normal(-200, 20, 6)).requires_grad_() for _ in range(2)]
    known = [side.detach() + torch.as_tensor(rng.normal(size=6)) for side in sides]
    beta = float(rng.uniform(0.05, 0.5))
    dpo_loss(implicit_margin(*sides, *known, beta)).backward()
    better, worse = (side.grad for side in sides)
    assert better is not None
    assert worse is not None
    assert (better < 0).all(), "descent raises it"
    torch.testing.assert_close(worse, -better)
    margin = implicit_margin(*[s.detach() for s in sides], *known, beta)
    torch.testing.assert_close(worse, beta * torch.sigmoid(-margin) / 6)


def test_the_margin_does_not_see_what_policy_and_reference_add_to_both(rng: np.random.Generator) -> None:
    better, worse, known_better, known_worse = torch.as_tensor(rng.normal(size=(4, 5)))
    margin = implicit_margin(better, worse, known_better, known_worse, 0.3)
    torch.testing.assert_close(implicit_margin(better + 7, worse + 7, known_better, known_worse, 0.3), margin)


# ---- pairs


def completions(texts: str) -> list[Completed]:
    return [Completed(text, 0.0) for text in texts]


def test_pairs_are_ordered_by_reward_and_use_no_answer_twice(rng: np.random.Generator) -> None:
    rewards = rng.normal(size=int(rng.integers(2, 12)))
    texts = [Completed(f"answer {i}", 0.0) for i in range(len(rewards))]
    reward_of = dict(zip(texts, rewards, strict=True))
    pairs = pairs_of(3, texts, rewards.tolist(), 0.0, 100)
    assert len(pairs) == len(rewards) // 2
    for pair in pairs:
        assert pair.clip == 3
        assert reward_of[pair.better] > reward_of[pair.worse]
        assert pair.gap == pytest.approx(reward_of[pair.better] - reward_of[pair.worse])
    assert all(a.gap >= b.gap for a, b in pairwise(pairs))
    assert len({text for pair in pairs for text in (pair.better, pair.worse)}) == 2 * len(pairs)
    assert reward_of[pairs[0].better] == rewards.max()
    assert reward_of[pairs[0].worse] == rewards.min()
    shuffled = rng.permutation(len(texts))
    assert pairs_of(3, [texts[i] for i in shuffled], rewards[shuffled].tolist(), 0.0, 100) == pairs


def test_ties_and_duplicates_give_no_pair() -> None:
    assert pairs_of(0, completions("abc"), [0.5, 0.5, 0.5], 0.0, 9) == []
    assert pairs_of(0, completions("aaa"), [0.5, 0.5, 0.5], 0.0, 9) == []
    assert pairs_of(0, completions("abaa"), [0.5, 0.2, 0.5, 0.5], 0.0, 9) == [Pair(0, *completions("ab"), 0.3)]
    assert pairs_of(0, completions("a"), [0.5], 0.0, 9) == []


def test_the_rewards_of_a_pair_differ_by_the_margin_and_pairs_are_as_few_as_asked() -> None:
    given, rewards = completions("abcdef"), [0.0, 0.1, 0.2, 0.4, 0.8, 1.6]
    assert [(p.better.text, p.worse.text) for p in pairs_of(0, given, rewards, 0.5, 9)] == [("f", "a"), ("e", "b")]
    assert [(p.better.text, p.worse.text) for p in pairs_of(0, given, rewards, 0.5, 1)] == [("f", "a")]


def test_the_same_seed_gives_the_same_pairs_however_many_are_decoded_at_a_time(rng: np.random.Generator) -> None:
    pictures = dict(zip([4, 7, 9], random_clips(rng, 3), strict=True))
    seeds, base = {4: 1, 7: 2, 9: 3}, exact_base()

    def drawn(batch_size: int) -> list[Pair]:
        answers = draw_answers(base, pictures, DRAWN, seeds, batch_size)
        return rank_pairs(answers, lambda clip, scenes: np.array([s.objects[0].mass for s in scenes]), 0.0, 9)

    pairs = drawn(64)
    assert {pair.clip for pair in pairs} <= {4, 7, 9}
    assert len(pairs) >= 3
    assert drawn(64) == pairs
    assert drawn(4) == pairs
    for pair in pairs:
        higher, lower = (read_completion(c.text).scene.objects[0].mass for c in (pair.better, pair.worse))
        assert higher - lower == pytest.approx(pair.gap)


# ---- training


def plan(**values: object) -> TrainingPlan:
    given = {
        "steps": 8,
        "epochs": 1.0,
        "batch_size": 2,
        "learning_rate": 3e-3,
        "lora_rank": 0,
        "checkpoint_steps": 4,
        "seed": 3,
    } | values
    return TrainingPlan(**given)  # type: ignore[arg-type]


def toy_pairs(rng: np.random.Generator, clips: np.ndarray) -> list[Pair]:
    answers = generate(small_base(), clips, DRAWN, list(range(len(clips))))
    return [Pair(c, each[0], each[1], 1.0) for c, each in enumerate(answers)]


@pytest.mark.parametrize("lora_rank", [0, 4])
def test_a_few_steps_raise_the_margin(rng: np.random.Generator, tmp_path: Path, lora_rank: int) -> None:
    base, before = small_base(), small_base()
    clips = random_clips(rng, 2)
    pairs = toy_pairs(rng, clips)
    rows: list[dict] = []
    rate = 1e-3 if not lora_rank else 1e-2
    prefer(
        base,
        pairs,
        dict(enumerate(clips)),
        0.1,
        DRAWN,
        plan(learning_rate=rate, lora_rank=lora_rank),
        tmp_path,
        rows.append,
    )
    curve = [row for row in rows if "loss" in row]
    assert [row["step"] for row in curve] == list(range(1, 9))
    assert curve[0]["loss"] == pytest.approx(np.log(2), abs=1e-3), "policy and reference are the same at first"
    assert curve[0]["margin"] == pytest.approx(0, abs=1e-3)
    assert curve[-1]["loss"] < curve[0]["loss"]
    assert curve[-1]["margin"] > 0.1
    assert curve[-1]["accuracy"] == 1
    for pair in pairs:
        clip = clips[pair.clip]
        gain = [log_p(base, c.text, clip) - log_p(before, c.text, clip) for c in (pair.better, pair.worse)]
        assert gain[0] > gain[1]


class PowerCut(Exception):
    pass


def test_an_interrupted_run_goes_on_with_the_same_reference(rng: np.random.Generator, tmp_path: Path) -> None:
    clips = random_clips(rng, 4)
    pairs, pictures = toy_pairs(rng, clips), dict(enumerate(clips))
    whole, again = [], []
    base, resumed = small_base(), small_base()
    prefer(base, pairs, pictures, 0.1, DRAWN, plan(), tmp_path / "whole", whole.append)

    def fail_at_six(row: dict) -> None:
        if row["step"] == 6:
            raise PowerCut

    with pytest.raises(PowerCut):
        prefer(small_base(), pairs, pictures, 0.1, DRAWN, plan(), tmp_path / "cut", fail_at_six)
    prefer(resumed, pairs, pictures, 0.1, DRAWN, plan(), tmp_path / "cut", again.append)
    for key in ("loss", "accuracy", "margin"):
        told = [[(row["step"], row[key]) for row in rows if key in row] for rows in (whole, again)]
        np.testing.assert_allclose(told[1], told[0], rtol=1e-2, atol=1e-3)
    for ours, theirs in zip(resumed.model.parameters(), base.model.parameters(), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-3)
