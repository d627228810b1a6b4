"""Prompts and completions as token ids, with any tokenizer, cut where the grammar's segments meet.

Cutting at the segments makes what is trained on and what is generated under the grammar the same tokens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from transformers import PreTrainedTokenizerBase

from pipeline.model.language.completion import PROMPT, completion_grammar
from pipeline.model.language.grammar import Element, Literal, Number, pieces, split

VIDEO_TOKEN = "<|video_pad|>"
END_TOKEN = "<|im_end|>"
QUESTION: dict = {"role": "user", "content": [{"type": "video"}, {"type": "text", "text": PROMPT}]}


@dataclass(frozen=True)
class Tokens:
    """ids (L,) of prompt, completion and end; prompt_length; free (L,): the model's to choose, where the grammar does
    not force it; numeric (L,): part of a number."""

    ids: np.ndarray
    prompt_length: int
    free: np.ndarray
    numeric: np.ndarray

    def behind(self, prompt: Sequence[int]) -> Tokens:
        """The same completion behind another prompt."""
        nothing = np.zeros(len(prompt), bool)
        own = slice(self.prompt_length, None)
        return Tokens(
            np.concatenate([np.array(prompt, np.int32), self.ids[own]]),
            len(prompt),
            np.concatenate([nothing, self.free[own]]),
            np.concatenate([nothing, self.numeric[own]]),
        )


NO_TOKENS = Tokens(np.zeros(0, np.int32), 0, np.zeros(0, bool), np.zeros(0, bool))


class Codec:
    """Text to ids and back. video_tokens: how many places the clip takes in the prompt."""

    def __init__(self, tokenizer: PreTrainedTokenizerBase, video_tokens: int) -> None:
        self.tokenizer = tokenizer
        self.video_token_id = tokenizer.convert_tokens_to_ids(VIDEO_TOKEN)
        self.end_id = tokenizer.convert_tokens_to_ids(END_TOKEN)
        self.pad_id = tokenizer.pad_token_id
        self._video_tokens = video_tokens
        self._pieces: dict[str, list[int]] = {}
        self.prompt_ids = self._chat_ids(self._chat([QUESTION]))

    def bodies_ids(self, texts: Sequence[str]) -> list[int]:
        """Ids of the question about bodies, each with a video and a text."""
        shown = [part for text in texts for part in ({"type": "video"}, {"type": "text", "text": text})]
        return self._chat_ids(self._chat([{"role": "user", "content": [*shown, {"type": "text", "text": PROMPT}]}]))

    def few_shot_ids(self, instructions: str, completions: Sequence[str], reasoning: bool, seconds: float) -> list[int]:
        """Ids of a chat: the instructions, the question about each example's video with its completion, and the
        question about the clip. Raises `GrammarError` for a completion that the grammar does not generate."""
        examples = [m for c in completions for m in (QUESTION, {"role": "assistant", "content": c})]
        rest = self._chat([{"role": "system", "content": instructions}, *examples, QUESTION])
        ids: list[int] = []
        for completion in completions:
            before, rest = rest.split(completion, 1)
            ids += self._chat_ids(before)
            for element, text in split(completion_grammar(reasoning, seconds), completion):
                ids += self.segment_ids(element, text)
        return ids + self._chat_ids(rest)

    def _chat(self, messages: list[dict]) -> str:
        return str(self.tokenizer.apply_chat_template(messages, tokenize=False, add_generation_prompt=True))

    def _chat_ids(self, text: str) -> list[int]:
        """Ids of a part of a chat, each video with as many places as its patches take."""
        ids = self.tokenizer(text, add_special_tokens=False)["input_ids"]
        return [i for id_ in ids for i in [id_] * (self._video_tokens if id_ == self.video_token_id else 1)]

    def piece_ids(self, piece: str) -> list[int]:
        """Ids of one piece of a segment."""
        if piece not in self._pieces:
            self._pieces[piece] = self.tokenizer(piece, add_special_tokens=False)["input_ids"]
        return self._pieces[piece]

    def segment_ids(self, element: Element, text: str) -> list[int]:
        return [i for piece in pieces(element, text) for i in self.piece_ids(piece)]

    def encode(self, completion: str, reasoning: bool, seconds: float) -> Tokens:
        """Ids of the prompt and a completion. Raises `GrammarError` for a text that the grammar does not generate."""
        return self.encode_segments(split(completion_grammar(reasoning, seconds), completion))

    def encode_segments(self, segments: Sequence[tuple[Element, str]]) -> Tokens:
        """Ids of the prompt and of a completion that `split` has cut."""
        ids = list(self.prompt_ids)
        free, numeric = [False] * len(ids), [False] * len(ids)
        for element, text in segments:
            new = self.segment_ids(element, text)
            ids += new
            free += [not isinstance(element, Literal)] * len(new)
            numeric += [isinstance(element, Number)] * len(new)
        return Tokens(
            np.array([*ids, self.end_id], np.int32),
            len(self.prompt_ids),
            np.array([*free, False]),
            np.array([*numeric, False]),
        )

    def decode(self, ids: list[int]) -> str:
        return str(self.tokenizer.decode(ids, skip_special_tokens=True))
