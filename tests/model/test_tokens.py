"""Tokenizers: the small one, and any other, cut where the grammar's segments meet."""

from itertools import pairwise

import numpy as np
import pytest
from random_walk import random_walk
from sampled_scenes import draw
from small_tokenizer import CHAT_TEMPLATE, SPECIAL_TOKENS, build_tokenizer
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import PreTrainedTokenizerFast

from pipeline.clips.events import Event
from pipeline.model.constrained_decoding import GrammarState, TrieCache
from pipeline.model.language.codec import END_TOKEN, VIDEO_TOKEN, Codec
from pipeline.model.language.completion import PROMPT, completion_grammar, read_completion, write_completion
from pipeline.model.language.grammar import GrammarError, Literal, Number, split

SMALL = build_tokenizer()


def byte_level_bpe() -> PreTrainedTokenizerFast:
    """A tokenizer like Qwen's, trained on a few completions."""
    core = Tokenizer(models.BPE())
    core.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    core.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=400,
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        special_tokens=list(SPECIAL_TOKENS),
        show_progress=False,
    )
    rng = np.random.default_rng(0)
    core.train_from_iterator(
        [random_walk(rng, completion_grammar(True, 1.0))[0] for _ in range(20)] + [PROMPT], trainer
    )
    return PreTrainedTokenizerFast(
        tokenizer_object=core,
        pad_token="<|endoftext|>",
        eos_token="<|im_end|>",
        chat_template=CHAT_TEMPLATE,
        clean_up_tokenization_spaces=False,
    )


#: In the form of Qwen2.5-VL's: without a system's turn it adds one of its own.
QWEN_TEMPLATE = (
    "{% for message in messages %}{% if loop.first and message['role'] != 'system' %}<|im_start|>system\n"
    "You are a helpful assistant.<|im_end|>\n{% endif %}<|im_start|>{{ message['role'] }}\n"
    "{% if message['content'] is string %}{{ message['content'] }}<|im_end|>\n{% else %}"
    "{% for content in message['content'] %}{% if content['type'] == 'video' %}"
    "<|vision_start|><|video_pad|><|vision_end|>{% elif 'text' in content %}{{ content['text'] }}{% endif %}"
    "{% endfor %}<|im_end|>\n{% endif %}{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
)
TOKENIZERS = {"small": SMALL, "bpe": byte_level_bpe()}


@pytest.fixture(params=list(TOKENIZERS))
def codec(request: pytest.FixtureRequest) -> Codec:
    return Codec(TOKENIZERS[request.param], 12)


@pytest.mark.parametrize("reasoning", [True, False])
def test_what_is_encoded_is_decoded(rng: np.random.Generator, codec: Codec, reasoning: bool) -> None:
    for _ in range(10):
        text, _ = random_walk(rng, completion_grammar(reasoning, 1.0))
        tokens = codec.encode(text, reasoning, 1.0)
        assert codec.decode(tokens.ids[tokens.prompt_length :].tolist()) == text
        assert tokens.ids[-1] == codec.end_id
        assert len(tokens.ids) == len(tokens.free) == len(tokens.numeric)
        assert not tokens.free[: tokens.prompt_length].any()
        assert (tokens.free | ~tokens.numeric).all()


def test_free_tokens_are_the_choices_and_numeric_ones_the_numbers(rng: np.random.Generator, codec: Codec) -> None:
    text, _ = random_walk(rng, completion_grammar(True, 1.0))
    tokens = codec.encode(text, True, 1.0)
    segments = split(completion_grammar(True, 1.0), text)
    chosen = "".join(piece for element, piece in segments if not isinstance(element, Literal))
    numbers = "".join(piece for element, piece in segments if isinstance(element, Number))
    assert codec.decode(tokens.ids[tokens.free].tolist()) == chosen
    assert codec.decode(tokens.ids[tokens.numeric].tolist()) == numbers


@pytest.mark.parametrize("reasoning", [True, False])
def test_the_small_tokenizer_cuts_a_whole_text_as_its_segments(rng: np.random.Generator, reasoning: bool) -> None:
    codec = Codec(SMALL, 12)
    for _ in range(20):
        text, _ = random_walk(rng, completion_grammar(reasoning, 1.0))
        pieces = split(completion_grammar(reasoning, 1.0), text)
        if any(
            isinstance(e, Number) and n == "0.000" and after.startswith("]") for (e, n), (_, after) in pairwise(pieces)
        ):
            continue  # ", 0.000]" is a fixed text, too, and a whole text is cut there as that
        tokens = codec.encode(text, reasoning, 1.0)
        assert SMALL(text, add_special_tokens=False)["input_ids"] == tokens.ids[tokens.prompt_length : -1].tolist()


def test_the_small_tokenizer_takes_two_tokens_a_number(rng: np.random.Generator) -> None:
    (scene,) = draw(int(rng.integers(2**31)), [0], {1: 1.0}).scenes
    text = write_completion(scene, [Event(0.5, "hits_ground", 0)], 1.0)
    tokens = Codec(SMALL, 12).encode(text, True, 1.0)
    numbers = sum(isinstance(e, Number) for e, _ in split(completion_grammar(True, 1.0), text))
    assert tokens.numeric.sum() == 2 * numbers
    assert SMALL.unk_token_id not in tokens.ids


def test_the_prompt_is_a_chat_with_a_place_for_each_piece_of_the_video(codec: Codec) -> None:
    ids = codec.prompt_ids
    place = ids.index(codec.video_token_id)
    assert ids[place : place + 12] == [codec.video_token_id] * 12
    assert ids.count(codec.video_token_id) == 12
    words = codec.tokenizer.decode(ids)
    assert PROMPT in words
    assert words.endswith("<|im_start|>assistant\n")
    assert words.startswith("<|im_start|>user\n<|vision_start|>" + VIDEO_TOKEN)
    assert codec.end_id == codec.tokenizer.convert_tokens_to_ids(END_TOKEN)


@pytest.mark.parametrize("template", [CHAT_TEMPLATE, QWEN_TEMPLATE])
def test_a_few_shot_prompt_is_the_templates_chat_with_completions_cut_as_they_are_decoded(
    rng: np.random.Generator, template: str
) -> None:
    tokenizer = byte_level_bpe()
    tokenizer.chat_template = template
    codec = Codec(tokenizer, 12)
    texts = [random_walk(rng, completion_grammar(True, 1.0))[0] for _ in range(3)]
    ids = codec.few_shot_ids("Look, then write.", texts, True, 1.0)
    turns = "".join(
        f"user\n<|vision_start|>{VIDEO_TOKEN * 12}<|vision_end|>{PROMPT}<|im_end|>\n<|im_start|>assistant\n"
        f"{text}<|im_end|>\n<|im_start|>"
        for text in texts
    )
    assert tokenizer.decode(ids).startswith(
        f"<|im_start|>system\nLook, then write.<|im_end|>\n<|im_start|>{turns}user\n"
    )
    assert ids.count(codec.video_token_id) == 4 * 12
    for text in texts:
        tokens = codec.encode(text, True, 1.0)
        written = tokens.ids[tokens.prompt_length :].tolist()
        assert any(ids[i : i + len(written)] == written for i in range(len(ids)))
    assert tokenizer.decode(ids).endswith(f"{PROMPT}<|im_end|>\n<|im_start|>assistant\n")


def test_a_text_of_another_grammar_is_not_encoded(codec: Codec) -> None:
    with pytest.raises(GrammarError):
        codec.encode("<think>\nhello", True, 1.0)
    with pytest.raises(GrammarError):
        codec.encode("<answer>\n", True, 1.0)


@pytest.mark.parametrize("reasoning", [True, False])
def test_random_choices_under_the_grammar_write_what_encode_splits_alike(
    rng: np.random.Generator, codec: Codec, reasoning: bool
) -> None:
    tries = TrieCache(codec)
    for _ in range(8):
        state = GrammarState(completion_grammar(reasoning, 1.0), codec, tries)
        ids, options = state.forced(), 0
        while not state.finished:
            allowed = state.allowed
            assert len(allowed) > 1
            ends = [t for t in allowed if "</" in codec.decode([t])]  # else random events go on for long
            token = ends[0] if ends and rng.random() < 0.3 else int(rng.choice(allowed))
            options += len(allowed)
            state.take(token)
            ids += [token, *state.forced()]
        read_completion(state.text)
        assert codec.decode(ids) == state.text
        tokens = codec.encode(state.text, reasoning, 1.0)
        assert ids == tokens.ids[tokens.prompt_length : -1].tolist()


def test_a_numbers_tokens_stand_in_ascending_order(codec: Codec) -> None:
    state = GrammarState(completion_grammar(False, 1.0), codec, TrieCache(codec))
    state.forced()
    assert state.numeric  # the camera's height, below 10
    begun = [float(text) for text in map(codec.decode, ([t] for t in state.allowed)) if text.strip(".").isdigit()]
    assert begun == sorted(begun)
    assert len(begun) > 9


def test_constrained_decoding_can_write_every_completion(rng: np.random.Generator, codec: Codec) -> None:
    tries = TrieCache(codec)
    for _ in range(5):
        text, _ = random_walk(rng, completion_grammar(True, 1.0))
        tokens = codec.encode(text, True, 1.0)
        state = GrammarState(completion_grammar(True, 1.0), codec, tries)
        wanted = tokens.ids[tokens.prompt_length : -1].tolist()
        done = len(state.forced())
        while not state.finished:
            assert wanted[done] in state.allowed
            state.take(wanted[done])
            done += 1 + len(state.forced())
        assert state.text == text


def test_the_tokenizer_is_saved_and_loaded_the_same(tmp_path: object, rng: np.random.Generator) -> None:
    SMALL.save_pretrained(str(tmp_path))
    again = PreTrainedTokenizerFast.from_pretrained(str(tmp_path))
    text, _ = random_walk(rng, completion_grammar(True, 1.0))
    assert again(text)["input_ids"] == SMALL(text)["input_ids"]
    assert Codec(again, 4).prompt_ids == Codec(SMALL, 4).prompt_ids
