"""The random numbers of one clip, which depend on nothing but its own name."""

import hashlib

import numpy as np


def clip_rng(seed: int, suite: str, clip: int, purpose: str) -> np.random.Generator:
    """The generator of clip `clip` of `suite`, for one purpose ("sample", "appearance", ...).

    From `SeedSequence((seed, suite, clip, purpose))`, words by their hash: whatever shard the clip is in, and
    whatever was drawn for other clips and purposes, its numbers are the same.
    """
    return np.random.default_rng(np.random.SeedSequence((seed, _number(suite), clip, _number(purpose))))


def _number(word: str) -> int:
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "little")
