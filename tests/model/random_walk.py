"""Texts of a grammar by random choices."""

import numpy as np

from pipeline.model.language.grammar import Grammar, Literal, Number, pieces


def random_walk(rng: np.random.Generator, grammar: Grammar, end: float = 0.2) -> tuple[str, list[str]]:
    """A text of random choices, and its pieces; lists go on with a chance of 1 - end."""
    text, cut = "", []
    element = next(grammar)
    while True:
        if isinstance(element, Literal):
            piece = element.text
        elif isinstance(element, Number):
            piece = element.text(rng.uniform(element.low, element.high))
            assert piece in element.options
        elif element.options[0].startswith(".\n</think>") and len(element.options) > 1:
            piece = element.options[0 if rng.random() < end else 1]
        else:
            piece = element.options[int(rng.integers(len(element.options)))]
        text += piece
        cut += pieces(element, piece)
        try:
            element = grammar.send(piece)
        except StopIteration:
            return text, cut
