"""How completions are drawn, and what one is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.model.decisions import Said


@dataclass(frozen=True)
class Sampling:
    """How completions are drawn.

    Attributes:
        samples: Of each clip.
        temperature: Of words; 0 is greedy, with one sample.
        top_p: Share of the distribution that words are drawn from (nucleus sampling).
        reasoning: Whether `<think>` comes before `<answer>`.
        seconds: Length of the clip.
        numbers: "quantiles", or "tokens": as words.
        middle: Share of a number's distribution, about its median, from which samples draw its quantile.
        most_tokens: An upper limit, more than the longest text has letters, whatever the tokenizer.
    """

    samples: int = 1
    temperature: float = 0.0
    top_p: float = 0.9
    reasoning: bool = True
    seconds: float = 1.0
    numbers: str = "quantiles"
    middle: float = 0.4
    most_tokens: int = 4000


@dataclass(frozen=True)
class Completed:
    """A completion and the log-probability, nats, that the model gave to its free choices.

    said: the decisions behind the text, where the words model wrote it.
    """

    text: str
    log_probability: float
    said: Said | None = None

    @classmethod
    def read(cls, row: Mapping[str, Any]) -> Completed:
        """From a row of a JSON file."""
        from pipeline.model.decisions import Said  # imports torch, which takes seconds

        said = row["said"]
        return cls(row["text"], row["log_probability"], None if said is None else Said(**said))


def batches(clips: int, samples: int, batch_size: int) -> Iterator[range]:
    """Runs of clips whose samples together fill a batch of `batch_size` sequences."""
    size = max(1, batch_size // samples)
    for start in range(0, clips, size):
        yield range(start, min(start + size, clips))
