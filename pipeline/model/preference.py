"""Preference optimisation: answers to a clip that are ranked by their replays, and DPO on pairs of them.

R. Rafailov et al., Direct Preference Optimization: Your Language Model is Secretly a Reward Model (2023). Nothing is
known of the clips but what the reward is made of: no labels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
import torch
from torch.nn import functional
from torch.utils.data import Dataset

from pipeline.model.answering import Shown, write
from pipeline.model.base import Base
from pipeline.model.language.completion import MAX_OBJECTS, read_completion
from pipeline.model.likelihood import ConstrainedTokens, constrained_tokens, log_probabilities
from pipeline.model.question import Question
from pipeline.model.sampling import Completed, Sampling, batches
from pipeline.model.shown import SeenBodies, SeenFrames, most_seen
from pipeline.model.trainer import Report, train
from pipeline.model.training_plan import TrainingPlan
from pipeline.model.words_example import Arrays, answers_example, chosen, tensors
from pipeline.model.words_loss import log_probabilities as words_log_probabilities
from pipeline.model.words_model import WordsModel
from pipeline.scene.scene import Scene

if TYPE_CHECKING:
    from pipeline.search.evaluator import Rewards

Judge = Callable[[int, Sequence[Scene]], np.ndarray]


@dataclass(frozen=True)
class Pair:
    """Two completions of a clip; gap: by how much the reward of the better one is higher."""

    clip: int
    better: Completed
    worse: Completed
    gap: float

    @classmethod
    def read(cls, row: Mapping[str, Any]) -> Pair:
        """From a row of the pairs' file."""
        return cls(row["clip"], Completed.read(row["better"]), Completed.read(row["worse"]), row["gap"])


def pairs_of(
    clip: int, completions: Sequence[Completed], rewards: Sequence[float], margin: float, most: int
) -> list[Pair]:
    """The best completion with the worst, the second best with the second worst, and so on: at most so many pairs.

    An answer that was given several times counts once. Rewards in a pair differ, by `margin` at least.
    """
    by_text = {c.text: (c, reward) for c, reward in zip(completions, rewards, strict=True)}
    distinct = sorted(by_text.values(), key=lambda item: (-item[1], item[0].text))
    half = len(distinct) // 2
    facing = zip(distinct[:half], reversed(distinct), strict=False)
    pairs = [Pair(clip, better, worse, high - low) for (better, high), (worse, low) in facing]
    return [pair for pair in pairs if pair.gap > 0 and pair.gap >= margin][:most]


def draw_answers(
    model: Base | WordsModel,
    shown: Mapping[int, Shown],
    sampling: Sampling,
    seeds: Mapping[int, int],
    batch_size: int,
) -> dict[int, list[Completed]]:
    """Sampled completions of each clip, about `batch_size` of them at a time; shown: what the model sees of each."""
    clips = list(shown)
    written: dict[int, list[Completed]] = {}
    for part in batches(len(clips), sampling.samples, batch_size):
        members = [clips[i] for i in part]
        answers = write(model, [shown[c] for c in members], sampling, [seeds[c] for c in members])
        written |= dict(zip(members, answers, strict=True))
    return written


def rank_pairs(answers: Mapping[int, Sequence[Completed]], judge: Judge, margin: float, most: int) -> list[Pair]:
    """The pairs of all clips; judge: the rewards of scenes of a clip, from its masks and flow alone."""
    pairs = []
    for clip, completions in answers.items():
        rewards = judge(clip, [read_completion(c.text).scene for c in completions])
        pairs += pairs_of(clip, completions, rewards.tolist(), margin, most)
    return pairs


def weighted_reward(rewards: Rewards, epe_weight: float) -> np.ndarray:
    """(B,) IoU - epe_weight * EPE (px over the whole frame): with 1 the search's reward."""
    return np.where(rewards.valid, rewards.iou - epe_weight * rewards.epe_frame, rewards.reward)


def implicit_margin(
    better: torch.Tensor,
    worse: torch.Tensor,
    reference_better: torch.Tensor,
    reference_worse: torch.Tensor,
    beta: float,
) -> torch.Tensor:
    """(B,) difference of the rewards that policy and reference imply (equation 5, without its constant), from the
    log-probabilities (B,), nats, of the better and the worse completions."""
    return beta * ((better - reference_better) - (worse - reference_worse))


def dpo_loss(margin: torch.Tensor) -> torch.Tensor:
    """Mean of -log sigmoid of the implicit margins (B,) (equation 7)."""
    return -functional.logsigmoid(margin).mean()


def prefer(
    model: Base | WordsModel,
    pairs: Sequence[Pair],
    shown: Mapping[int, Shown],
    beta: float,
    sampling: Sampling,
    plan: TrainingPlan,
    work: Path,
    report: Report,
) -> None:
    """Train `model` in place on the pairs of clips, with itself as it is now as the reference.

    shown: what the model sees of each clip. work, report: as `train`; rows have loss, accuracy (share of pairs whose
    better completion has the higher implied reward) and margin (mean of the implied rewards' differences).
    """
    likelihoods = (
        _WordsLikelihoods(model, sampling) if isinstance(model, WordsModel) else _TextLikelihoods(model, sampling)
    )
    rows = [likelihoods.row(pair, shown[pair.clip]) for pair in pairs]
    with torch.no_grad():
        parts = [rows[i : i + plan.batch_size] for i in range(0, len(rows), plan.batch_size)]
        reference = torch.cat([torch.stack(likelihoods.both(part), 1) for part in parts]).cpu()

    def objective(batch: Sequence[tuple[Any, torch.Tensor]]) -> tuple[torch.Tensor, Mapping[str, float]]:
        better, worse = likelihoods.both([row for row, _ in batch])
        known = torch.stack([known for _, known in batch]).to(better.device)
        margin = implicit_margin(better, worse, known[:, 0], known[:, 1], beta)
        implied = margin.detach()
        return dpo_loss(margin), {"accuracy": (implied > 0).float().mean().item(), "margin": implied.mean().item()}

    examples = list(zip(rows, reference, strict=True))
    train(model, cast(Dataset, examples), list, objective, plan, work, report)


class _Likelihoods(Protocol):
    """How likely a model finds the two completions of a pair."""

    def row(self, pair: Pair, shown: Shown) -> Any:
        """A pair as it is trained on."""

    def both(self, rows: Sequence[Any]) -> tuple[torch.Tensor, torch.Tensor]:
        """Log-probabilities (B,) of the better and of the worse completions, in one pass."""


class _TextLikelihoods(_Likelihoods):
    """Of a model with a tokenizer."""

    def __init__(self, base: Base, sampling: Sampling) -> None:
        self._base, self._sampling = base, sampling

    def row(self, pair: Pair, shown: Shown) -> tuple[ConstrainedTokens, ConstrainedTokens, np.ndarray]:
        assert isinstance(shown, np.ndarray | Question)
        prompt, videos = (shown.ids, shown.videos) if isinstance(shown, Question) else (None, shown[None])
        better, worse = (
            constrained_tokens(self._base, c.text, self._sampling.reasoning, self._sampling.seconds, prompt)
            for c in (pair.better, pair.worse)
        )
        return better, worse, videos

    def both(self, rows: Sequence[Any]) -> tuple[torch.Tensor, torch.Tensor]:
        better, worse, videos = zip(*rows, strict=True)
        both = torch.as_tensor(np.concatenate(videos)).repeat(2, 1, 1, 1, 1)
        first, second = log_probabilities(self._base, [*better, *worse], both).chunk(2)
        return first, second


class _WordsLikelihoods(_Likelihoods):
    """Of the words model."""

    def __init__(self, model: WordsModel, sampling: Sampling) -> None:
        self._model, self._sampling = model, sampling

    def row(self, pair: Pair, shown: Shown) -> tuple[Arrays, bool]:
        assert (
            isinstance(shown, SeenBodies | SeenFrames) and pair.better.said is not None and pair.worse.said is not None
        )
        seen = most_seen(shown, MAX_OBJECTS) if isinstance(shown, SeenBodies) else shown
        colours = seen.colours if isinstance(seen, SeenFrames) else seen.colours is not None
        return answers_example(seen, [pair.better.said, pair.worse.said], self._sampling.reasoning), colours

    def both(self, rows: Sequence[Any]) -> tuple[torch.Tensor, torch.Tensor]:
        # one clip at a time: clips differ in their number of bodies, and pairs are few
        found = []
        for arrays, colours in rows:
            both = tensors([arrays])
            which = torch.arange(2)
            group = chosen(both, torch.zeros_like(which), which)
            found.append(words_log_probabilities(self._model.model, group, colours))
        better, worse = torch.stack(found, 1)
        return better, worse
