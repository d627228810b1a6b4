"""Models so small that a test can train them, and made-up clips for them."""

from functools import cache

import numpy as np
from small_tokenizer import build_tokenizer
from tiny_qwen import TinySize, build_tiny

from pipeline.clips.events import Event
from pipeline.model.base import Base
from pipeline.model.constrained_decoding import TrieCache
from pipeline.model.language.codec import Codec, Tokens
from pipeline.model.language.completion import write_completion
from pipeline.model.model_input import ModelInput
from pipeline.model.patches import PatchLayout
from pipeline.scene.scene import Camera, Scene, SceneObject

LAYOUT = PatchLayout(64, 32, 4, patch=16, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))
SIZE = TinySize(
    hidden=48,
    layers=2,
    heads=2,
    intermediate=64,
    vision_hidden=32,
    vision_depth=2,
    vision_heads=2,
    vision_intermediate=64,
    patch=16,
)


INPUT = ModelInput(
    input="flow", picture="channels", flow_source="exact", flow_size=(240, 160), flow_iterations=4, reasoning=True
)


@cache
def tries() -> TrieCache:
    return TrieCache(Codec(build_tokenizer(), LAYOUT.tokens))


def small_base(seed: int = 0) -> Base:
    tokenizer = build_tokenizer()
    model = build_tiny(tokenizer, SIZE, seed).eval()
    base = Base(model, tokenizer, LAYOUT, Codec(tokenizer, LAYOUT.tokens), INPUT)
    base.tries = tries()  # which takes seconds to build
    return base


def exact_base() -> Base:
    """In float64: rounding, which depends on what else is in the batch, changes no draw (in float32 it may)."""
    base = small_base()
    base.model.double()
    return base


def random_clips(rng: np.random.Generator, count: int) -> np.ndarray:
    """(B, T, H, W, 3) uint8."""
    return rng.integers(0, 256, (count, LAYOUT.frames, LAYOUT.height, LAYOUT.width, 3), dtype=np.uint8)


def random_tokens(rng: np.random.Generator, base: Base) -> Tokens:
    ball = SceneObject("sphere", (float(rng.uniform(0.05, 0.3)),), 1.0, position=tuple(rng.uniform(-1, 1, 3)))
    scene = Scene((ball,), Camera((0, -2, float(rng.uniform(0.5, 1.5))), 40, pitch=-20))
    return base.codec.encode(write_completion(scene, [Event(0.25, "hits_ground", 0)], 1.0), True, 1.0)
