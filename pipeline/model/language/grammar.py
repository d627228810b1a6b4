"""Grammars as generators, for writing, checking, tokenizing and constrained decoding with one definition.

A grammar is a generator of `Element`s: fixed text, a choice, or a number. It is sent the text that stands in
each place, and may let that decide what comes next (the number of objects, the earliest time of an event). The
same generator writes a text (`spell`), splits a finished text into segments (`split`), and steers a model token by
token (`pipeline.model.constrained_decoding`).
"""

from __future__ import annotations

import functools
from collections.abc import Generator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Literal:
    """Fixed text."""

    text: str


@dataclass(frozen=True)
class Choice:
    """One of a few texts, none of which begins another."""

    options: tuple[str, ...]


@dataclass(frozen=True)
class Number:
    """A decimal number with `decimals` digits after the point, between low and high."""

    decimals: int
    low: float
    high: float

    def text(self, value: float) -> str:
        """`value` as it is written in this place, moved into the bounds where it lies outside."""
        bounded = min(max(value, self.low), self.high)
        text = f"{bounded:.{self.decimals}f}"
        return text.lstrip("-") if float(text) == 0 else text

    @property
    def options(self) -> frozenset[str]:
        return _number_texts(self.decimals, self.low, self.high)


Element = Literal | Choice | Number
Grammar = Generator[Element, str, None]


class GrammarError(ValueError):
    """A text that the grammar does not generate."""


@functools.lru_cache(maxsize=512)
def _number_texts(decimals: int, low: float, high: float) -> frozenset[str]:
    scale = 10**decimals
    values = range(round(low * scale), round(high * scale) + 1)
    return frozenset(f"{v / scale:.{decimals}f}" for v in values)


@functools.lru_cache(maxsize=512)
def _prefixes(element: Choice | Number) -> frozenset[str]:
    """Every beginning of every text the element allows, the whole texts included."""
    return frozenset(option[:k] for option in element.options for k in range(len(option) + 1))


def split(grammar: Grammar, text: str) -> list[tuple[Element, str]]:
    """The segments of `text`, with the element that each belongs to. Raises `GrammarError`."""
    segments: list[tuple[Element, str]] = []
    position = 0
    element = next(grammar)
    while True:
        piece = _match(element, text, position)
        segments.append((element, piece))
        position += len(piece)
        try:
            element = grammar.send(piece)
        except StopIteration:
            break
    if position != len(text):
        raise GrammarError(f"text goes on after its end: {text[position : position + 40]!r}")
    return segments


def _match(element: Element, text: str, position: int) -> str:
    if isinstance(element, Literal):
        if text.startswith(element.text, position):
            return element.text
        expected = repr(element.text)
    else:
        allowed = _prefixes(element)
        end = position
        while end < len(text) and text[position : end + 1] in allowed:
            end += 1
        if text[position:end] in element.options:
            return text[position:end]
        expected = str(element) if isinstance(element, Number) else f"one of {element.options}"
    raise GrammarError(f"at character {position}: {text[position : position + 40]!r}, expected {expected}")


def pieces(element: Element, text: str) -> list[str]:
    """How a segment is cut for the tokenizer: numbers before their last two characters, the rest whole."""
    return [text[:-2], text[-2:]] if isinstance(element, Number) else [text]


def spell(grammar: Grammar, values: Sequence[str | float]) -> str:
    """The text in which choices and numbers take `values`, in order."""
    remaining = iter(values)
    text = ""
    element = next(grammar)
    while True:
        if isinstance(element, Literal):
            piece = element.text
        else:
            value = next(remaining)
            piece = element.text(float(value)) if isinstance(element, Number) else str(value)
        text += piece
        try:
            element = grammar.send(piece)
        except StopIteration:
            break
    assert next(remaining, None) is None, "more values than places"
    return text
