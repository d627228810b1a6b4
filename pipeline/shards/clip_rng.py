"""The random numbers of one clip, which depend on its own name alone."""

import hashlib

import numpy as np


def clip_rng(seed: int, suite: str, clip: int, purpose: str) -> np.random.Generator:
    """The generator of clip `clip` of `suite`, for one purpose, as "sample" or "appearance".

    It is made of `SeedSequence((seed, suite, clip, purpose))`, with the hashes of the words, so that it does not depend
    on the shard of the clip, nor on what is drawn for other clips and purposes.

    Args:
        seed: The seed of the experiment.
        suite: The suite's name.
        clip: The clip's index in its suite.
        purpose: What the numbers are for.
    """
    return np.random.default_rng(np.random.SeedSequence((seed, _number(suite), clip, _number(purpose))))


def _number(word: str) -> int:
    return int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "little")
