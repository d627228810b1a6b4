"""The small tokenizer of the tiny model: one token for every fixed text of the grammar, two for every number."""

from __future__ import annotations

import itertools
import re

from tokenizers import Regex, Tokenizer, decoders, models, pre_tokenizers
from transformers import PreTrainedTokenizerFast

from pipeline.model.language.completion import EVENT_PHRASES, MAX_OBJECTS, PROMPT, completion_grammar
from pipeline.model.language.grammar import Literal, Number
from pipeline.scene.scene import BASIC_SHAPES

SPECIAL_TOKENS = (
    "<|endoftext|>",
    "<|im_start|>",
    "<|im_end|>",
    "<|vision_start|>",
    "<|vision_end|>",
    "<|image_pad|>",
    "<|video_pad|>",
    "<|unk|>",
)
CHAT_TEMPLATE = (
    "{% for message in messages %}<|im_start|>{{ message['role'] }}\n"
    "{% if message['content'] is string %}{{ message['content'] }}{% else %}{% for part in message['content'] %}"
    "{% if part['type'] == 'video' %}<|vision_start|><|video_pad|><|vision_end|>{% else %}{{ part['text'] }}{% endif %}"
    "{% endfor %}{% endif %}<|im_end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
)
#: A number is cut before its last two digits; its head may also stand alone, as a piece to be encoded.
_NUMBER = r"-?\d+\.\d(?=\d\d(?!\d)|\z)|-?\d+\.(?=\d\d(?!\d)|\z)|\d\d"


def grammar_texts() -> list[str]:
    """Every fixed text and every option of the grammar, sorted; found by walking it over all pairs of shapes."""
    texts: set[str] = set()
    for reasoning, count in itertools.product((True, False), range(1, MAX_OBJECTS + 1)):
        for first, second in itertools.product(BASIC_SHAPES, repeat=2):
            texts |= _walk(reasoning, count, itertools.cycle((first, second)))
    return sorted(texts)


def _walk(reasoning: bool, count: int, shapes: itertools.cycle[str]) -> set[str]:
    texts: set[str] = set()
    phrases = iter(EVENT_PHRASES)  # one event of each kind, then the end
    written = 0
    grammar = completion_grammar(reasoning, 1.0)
    element = next(grammar)
    while True:
        if isinstance(element, Literal):
            piece = element.text
            texts.add(piece)
        elif isinstance(element, Number):
            piece = element.text(0.5)
        else:
            texts |= set(element.options)
            piece = element.options[0]
            if piece in BASIC_SHAPES:
                piece, written = next(shapes), written + 1
            elif piece.endswith(("object: ", "objects: ")):
                piece = element.options[count - 1]
            elif "</think>" in piece:
                piece = element.options[1 if next(phrases, None) else 0]
            elif piece == "- shape: " and written == count:
                piece = element.options[1]
        try:
            element = grammar.send(piece)
        except StopIteration:
            return texts


def build_tokenizer() -> PreTrainedTokenizerFast:
    """The tiny model's tokenizer, with the chat template and special tokens of Qwen2.5-VL's conventions."""
    literals = [*grammar_texts(), "user\n", "assistant\n", "\n", PROMPT]
    tails = [f"{i:02d}" for i in range(100)]
    heads = [f"{sign}{i}." for sign in ("", "-") for i in range(100)]
    heads += [f"{sign}{i // 10}.{i % 10}" for sign in ("", "-") for i in range(100)]
    words = list(dict.fromkeys([*SPECIAL_TOKENS, *literals, *heads, *tails]))
    pattern = "|".join([_NUMBER, *(re.escape(t) for t in sorted(literals, key=len, reverse=True))])
    core = Tokenizer(models.WordLevel({word: i for i, word in enumerate(words)}, unk_token="<|unk|>"))
    core.pre_tokenizer = pre_tokenizers.Split(Regex(pattern), "isolated")
    core.decoder = decoders.Fuse()
    tokenizer = PreTrainedTokenizerFast(
        tokenizer_object=core,
        pad_token="<|endoftext|>",
        eos_token="<|im_end|>",
        unk_token="<|unk|>",
        additional_special_tokens=[t for t in SPECIAL_TOKENS if t not in ("<|endoftext|>", "<|im_end|>", "<|unk|>")],
        padding_side="left",
        clean_up_tokenization_spaces=False,
        chat_template=CHAT_TEMPLATE,
    )
    return tokenizer
