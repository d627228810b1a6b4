"""The model's answers to a clip: one greedy, K sampled."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from pipeline.language.completion import Completion, read_completion
from pipeline.model.base import Base
from pipeline.model.generate import Sampling, batches, generate
from pipeline.model.patches import resize_frames
from pipeline.model.walker import Tries
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px

BATCH = 16  # sequences decoded at a time


@dataclass(frozen=True)
class Answer:
    """What the model wrote, parsed. sample: -1 greedy, else 0 to K - 1. log_probability: nats."""

    sample: int
    text: str
    parsed: Completion
    log_probability: float


def model_pictures(flow: np.ndarray, frames: np.ndarray, kind: str, interval: float, base: Base) -> np.ndarray:
    """What the model is shown (P, H, W, 3): pictures of flow (P, h, w, 2), px, or the frames (P, h, w, 3) themselves.

    kind: "flow" or "rgb", as the model was trained. interval: s between the frames of a pair.
    """
    shown = flow_picture(flow, "channels", scaled_max_px(flow.shape[2], interval)) if kind == "flow" else frames
    return resize_frames(shown, base.layout.width, base.layout.height)


def ask(base: Base, shown: np.ndarray, sampling: Sampling, seed: int) -> list[Answer]:
    """The greedy answer and the sampled ones, under the grammar: all of them parse."""
    tries = Tries(base.codec)
    answers = []
    greedy = replace(sampling, samples=1, temperature=0.0)
    for done in generate(base, shown[None], greedy, [seed], tries)[0]:
        answers.append(Answer(-1, done.text, read_completion(done.text), done.log_probability))
    for part in batches(sampling.samples, 1, BATCH):
        own = zlib.crc32(f"{seed} {part.start}".encode())
        of_part = replace(sampling, samples=len(part))
        for k, done in zip(part, generate(base, shown[None], of_part, [own], tries)[0], strict=True):
            answers.append(Answer(k, done.text, read_completion(done.text), done.log_probability))
    return answers


def tally(compositions: list[str]) -> str:
    """`box+sphere (6), sphere (3)`: compositions and how often each was answered, the most frequent first."""
    return ", ".join(f"{name} ({count})" for name, count in Counter(compositions).most_common(4))
