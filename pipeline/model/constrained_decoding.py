"""Constrained decoding: which tokens may come next under the grammar, for one sequence that is being written."""

from __future__ import annotations

import functools

from pipeline.model.language.codec import Codec
from pipeline.model.language.grammar import Element, Grammar, Literal, Number

Trie = dict[int, "Trie | str"]  # token -> what may follow, or the whole text where the element ends


class TrieCache:
    """For each choice and number of the grammar a trie of its texts' tokens, those of numbers in ascending order.

    A trie is built when it is first needed, and kept.
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self.of = functools.cache(self._build)

    def _build(self, element: Element) -> Trie:
        assert not isinstance(element, Literal)
        root: Trie = {}
        for text in element.options:
            node = root
            *path, last = self._codec.segment_ids(element, text)
            for token in path:
                child = node.setdefault(token, {})
                assert isinstance(child, dict), "no option's tokens begin another's"
                node = child
            node[last] = text
        return ascending(root) if isinstance(element, Number) else root


def ascending(trie: Trie) -> Trie:
    """The trie with its tokens in the order of the numbers that they begin. Where the numbers that a token begins are
    not neighbours (1.5 and 15, with a tokenizer that splits numbers into digits), the one nearest to zero counts."""
    children = {token: node if isinstance(node, str) else ascending(node) for token, node in trie.items()}
    return dict(sorted(children.items(), key=lambda item: _nearest_to_zero(item[1])))


def _nearest_to_zero(node: Trie | str) -> float:
    return float(node) if isinstance(node, str) else min(map(_nearest_to_zero, node.values()), key=abs)


class GrammarState:
    """The state of the grammar in one sequence.

    Append the tokens of `forced()`, choose one of `allowed` and give it to `take`, and repeat until `finished`.

    Attributes:
        text: What has been written.
        numeric: Whether the next token belongs to a number; `allowed` is then in ascending order.
        quantile: The quantile to follow in this number, for a sampler that draws by them; None at its start.
    """

    def __init__(self, grammar: Grammar, codec: Codec, tries: TrieCache) -> None:
        self._grammar, self._codec, self._tries = grammar, codec, tries
        self._element: Element | None = next(grammar)
        self._node: Trie = {}
        self.text = ""
        self.numeric = False
        self.quantile: float | None = None
        self._enter()

    @property
    def finished(self) -> bool:
        return self._element is None

    @property
    def allowed(self) -> list[int]:
        return list(self._node)

    def forced(self) -> list[int]:
        """The tokens that follow without a choice: fixed texts, and places where one token alone is allowed."""
        ids: list[int] = []
        while self._element is not None:
            if isinstance(self._element, Literal):
                ids += self._codec.segment_ids(self._element, self._element.text)
                self._advance(self._element.text)
            elif len(self._node) == 1:
                token = next(iter(self._node))
                ids.append(token)
                self.take(token)
            else:
                break
        return ids

    def take(self, token: int) -> None:
        """Append one of the `allowed` tokens."""
        following = self._node[token]
        if isinstance(following, str):
            self._advance(following)
        else:
            self._node = following

    def _advance(self, text: str) -> None:
        self.text += text
        try:
            self._element = self._grammar.send(text)
        except StopIteration:
            self._element = None
        self._enter()

    def _enter(self) -> None:
        self.numeric = isinstance(self._element, Number)
        self.quantile = None
        if self._element is not None and not isinstance(self._element, Literal):
            self._node = self._tries.of(self._element)
