"""A words model for tests, with random weights."""

import torch

from pipeline.model.words_network import WordsConfig, WordsNetwork

TINY = WordsConfig(
    width=48, layers=2, heads=3, inner=96, vision_width=32, vision_depth=2, vision_heads=2, vision_inner=64
)


def tiny_words() -> WordsNetwork:
    """The network, in training mode; the same each time."""
    torch.manual_seed(0)
    return WordsNetwork(TINY)
