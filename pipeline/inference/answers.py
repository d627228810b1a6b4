"""The model's answers to clips: one greedy and K sampled each, under the grammar, so that all of them parse."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from pipeline.model.answering import Shown, write
from pipeline.model.language.completion import Completion, read_completion
from pipeline.model.sampling import Sampling, batches
from pipeline.scene.scene import Scene

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.generate import Prompt
    from pipeline.model.words_model import WordsModel

GREEDY = -1  # the number of the greedy answer among the samples


@dataclass(frozen=True)
class Answer:
    """What the model wrote.

    Attributes:
        sample: GREEDY, or 0 to K - 1.
        text: The completion.
        log_probability: nats, that the model gave to its free choices.
        seen: The scene with the camera of the clip's own picture; None: the model was shown that.
    """

    sample: int
    text: str
    log_probability: float
    seen: Scene | None = None

    @cached_property
    def completion(self) -> Completion:
        """The text, parsed."""
        return read_completion(self.text)

    @property
    def scene(self) -> Scene:
        """What it says, seen by the camera of the clip's own picture."""
        return self.seen or self.completion.scene


def answer_seed(*labels: object) -> int:
    """The seed of a clip's samples, from what the clip is called."""
    return zlib.crc32(" ".join(map(str, labels)).encode())


def ask(
    base: Base | WordsModel,
    show: Callable[[int], Shown],
    seeds: Sequence[int],
    sampling: Sampling,
    batch_size: int,
    prompt: Prompt | None = None,
) -> list[list[Answer]]:
    """Ask the model about clips.

    Args:
        base: The model.
        show: What the model is shown of clip i: pictures (T, H, W, 3) uint8 in its layout, or bodies or frames for the
            words model; called when it is needed.
        seeds: (B,) Of each clip's samples.
        sampling: Of the samples, K of each clip, which may be 0.
        batch_size: Sequences decoded at a time.
        prompt: With worked examples; None for the question alone.

    Returns:
        For each clip the greedy answer, then the samples in their order.
    """
    answers: list[list[Answer]] = [[] for _ in seeds]
    greedy = replace(sampling, samples=1, temperature=0.0)
    for first, asked in ((GREEDY, greedy), (0, sampling)):
        for part in batches(len(seeds), asked.samples, batch_size) if asked.samples else ():
            written = write(base, [show(i) for i in part], asked, [seeds[i] for i in part], prompt)
            for i, completions in zip(part, written, strict=True):
                answers[i] += [Answer(first + k, c.text, c.log_probability) for k, c in enumerate(completions)]
    return answers
