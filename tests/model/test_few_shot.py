"""Prompts with worked examples, on tiny random models."""

import numpy as np
import pytest
import torch
from random_walk import random_walk
from small_base import LAYOUT, random_clips, small_base

from pipeline.model.base import Base
from pipeline.model.forward import rotary_positions
from pipeline.model.generate import Prompt, bare_prompt, few_shot_prompt, generate
from pipeline.model.language.completion import completion_grammar, read_completion
from pipeline.model.language.few_shot import PICTURES, TEMPLATE, instructions
from pipeline.model.language.grammar import GrammarError
from pipeline.model.patches import pack_video
from pipeline.model.sampling import Sampling
from pipeline.vision.flow.flow_picture import KINDS

BASE = small_base()


def random_prompt(rng: np.random.Generator, base: Base, shots: int, reasoning: bool = True) -> tuple[Prompt, list[str]]:
    texts = [random_walk(rng, completion_grammar(reasoning, 1.0))[0] for _ in range(shots)]
    return few_shot_prompt(base, "What follows.", random_clips(rng, shots), texts, reasoning, 1.0), texts


def starts_of_videos(base: Base, prompt: Prompt) -> list[int]:
    is_video = np.array(prompt.ids) == base.codec.video_token_id
    return np.flatnonzero(is_video & ~np.concatenate([[False], is_video[:-1]])).tolist()


@torch.no_grad()
def states(base: Base, prompt: Prompt, videos: np.ndarray) -> np.ndarray:
    """(P, D) of the prompt with these videos, the clip's own last."""
    out = base.model.model(
        input_ids=torch.tensor([prompt.ids]),
        pixel_values_videos=pack_video(torch.as_tensor(videos), base.layout),
        video_grid_thw=torch.tensor([base.layout.grid] * len(videos)),
        position_ids=rotary_positions(base, torch.tensor([prompt.ids])),
        use_cache=False,
    )
    return out.last_hidden_state[0].numpy()


@pytest.mark.parametrize("shots", [1, 3])
@pytest.mark.parametrize("reasoning", [True, False])
def test_a_prompt_is_a_chat_of_examples_each_video_before_its_text_and_then_the_clip(
    rng: np.random.Generator, shots: int, reasoning: bool
) -> None:
    prompt, texts = random_prompt(rng, BASE, shots, reasoning)
    assert len(prompt.videos) == shots
    starts = starts_of_videos(BASE, prompt)
    assert len(starts) == shots + 1
    assert prompt.ids.count(BASE.codec.video_token_id) == (shots + 1) * LAYOUT.tokens
    ends = [*starts[1:], len(prompt.ids)]
    for text, start, end in zip(texts, starts, ends, strict=False):
        segments = BASE.codec.encode(text, reasoning, 1.0)
        written = segments.ids[segments.prompt_length :].tolist()  # with its end
        between = list(prompt.ids[start + LAYOUT.tokens : end])
        (place,) = [i for i in range(len(between)) if between[i : i + len(written)] == written]
        assert BASE.codec.decode(between[:place]).endswith("assistant\n")
    asked = BASE.codec.prompt_ids
    assert list(prompt.ids[-len(asked) :]) == asked, "what the fine-tuned model is asked"


def test_the_bare_prompt_is_that_of_training(rng: np.random.Generator) -> None:
    clips = random_clips(rng, 1)
    told = [generate(BASE, clips, Sampling(), [1], prompt) for prompt in (None, bare_prompt(BASE))]
    assert told[0] == told[1]


def test_each_video_is_seen_at_its_own_place_and_nowhere_before(rng: np.random.Generator) -> None:
    prompt, _ = random_prompt(rng, BASE, 3)
    videos = np.concatenate([prompt.videos, random_clips(rng, 1)])
    before = states(BASE, prompt, videos)
    for k, start in enumerate(starts_of_videos(BASE, prompt)):
        changed = videos.copy()
        changed[k] = random_clips(rng, 1)[0]
        moved = np.abs(states(BASE, prompt, changed) - before).max(1) > 1e-5
        assert not moved[:start].any()
        assert moved[start : start + LAYOUT.tokens].all()
        assert moved[-1], "and the answer knows of it"


def test_positions_count_on_from_video_to_video(rng: np.random.Generator) -> None:
    prompt, _ = random_prompt(rng, BASE, 2)
    where = rotary_positions(BASE, torch.tensor([prompt.ids]))[:, 0].numpy()
    t, h, w = LAYOUT.grid
    starts = starts_of_videos(BASE, prompt)
    for start in starts:
        inside = where[:, start : start + LAYOUT.tokens] - where[:, start - 1, None] - 1
        assert [len(np.unique(axis)) for axis in inside] == [t, h // LAYOUT.merge, w // LAYOUT.merge]
        assert inside.min() == 0
        after = where[:, start + LAYOUT.tokens]
        assert (after == where[:, : start + LAYOUT.tokens].max() + 1).all()


@pytest.mark.parametrize("temperature", [0.0, 2.0])
def test_answers_to_a_prompt_with_examples_parse_and_depend_on_clip_and_examples(
    rng: np.random.Generator, temperature: float
) -> None:
    base = small_base(int(rng.integers(1000)))
    prompt, _ = random_prompt(rng, base, 2)
    clips = random_clips(rng, 2)
    sampling = Sampling(1 if not temperature else 2, temperature, top_p=1.0)
    told = generate(base, clips, sampling, [5, 5], prompt)
    for answer in (a for answers in told for a in answers):
        assert read_completion(answer.text).scene.objects
    others = Prompt(prompt.ids, random_clips(rng, 2))
    swapped = Prompt(prompt.ids, prompt.videos[::-1].copy())
    first = [generate(base, clips[:1], sampling, [5], p)[0][0].log_probability for p in (prompt, others, swapped)]
    seen = [told[1][0].log_probability, *first]
    assert told[0][0].log_probability == pytest.approx(first[0], abs=0.02), "whatever else is in the batch"
    assert len({round(v, 4) for v in seen}) == 4


def test_an_example_that_the_grammar_does_not_generate_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(GrammarError):
        few_shot_prompt(BASE, "What follows.", random_clips(rng, 1), ["<answer>\nno"], False, 1.0)


def test_the_instructions_speak_of_what_is_shown_and_asked() -> None:
    assert set(PICTURES) == {*KINDS, "rgb"}
    texts = {(k, r): instructions(k, r, 10, 1.0, 30, 32.0, 480) for k in PICTURES for r in (True, False)}
    assert len(set(texts.values())) == 6
    for (kind, reasoning), text in texts.items():
        assert ("optical flow" in text) == (kind != "rgb")
        assert ("<think>" in text) == reasoning
        assert "{{" not in text and "{%" not in text
        for word in ("sphere {radius}", "box {width, depth, height}", "sliding_friction", "<answer>", "z up"):
            assert word in text
    assert TEMPLATE.is_file()
