"""Preference optimisation: answers to a clip that are ranked by their replays, and DPO on pairs of them.

R. Rafailov et al., Direct Preference Optimization: Your Language Model is Secretly a Reward Model (2023). Nothing is
known of the clips but what the reward is made of: no labels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
import torch
from torch.nn import functional
from torch.utils.data import Dataset

from pipeline.language.completion import read_completion
from pipeline.model.base import Base
from pipeline.model.generate import generate
from pipeline.model.likelihood import ConstrainedTokens, constrained_tokens, log_probabilities
from pipeline.model.sampling import Sampling, batches
from pipeline.model.trainer import Report, train
from pipeline.model.training_plan import TrainingPlan
from pipeline.scene.scene import Scene

if TYPE_CHECKING:
    from pipeline.search.evaluator import Rewards

Judge = Callable[[int, Sequence[Scene]], np.ndarray]


@dataclass(frozen=True)
class Pair:
    """Two completions of a clip; gap: by how much the reward of the better one is higher."""

    clip: int
    better: str
    worse: str
    gap: float


def pairs_of(clip: int, completions: Sequence[str], rewards: Sequence[float], margin: float, most: int) -> list[Pair]:
    """The best completion with the worst, the second best with the second worst, and so on: at most so many pairs.

    An answer that was given several times counts once. Rewards in a pair differ, by `margin` at least.
    """
    distinct = sorted(dict(zip(completions, rewards, strict=True)).items(), key=lambda item: (-item[1], item[0]))
    half = len(distinct) // 2
    facing = zip(distinct[:half], reversed(distinct), strict=False)
    pairs = [Pair(clip, better, worse, high - low) for (better, high), (worse, low) in facing]
    return [pair for pair in pairs if pair.gap > 0 and pair.gap >= margin][:most]


def draw_answers(
    base: Base, pictures: Mapping[int, np.ndarray], sampling: Sampling, seeds: Mapping[int, int], batch_size: int
) -> dict[int, list[str]]:
    """Sampled completions of each clip (T, H, W, 3) uint8, about `batch_size` of them at a time."""
    clips = list(pictures)
    written: dict[int, list[str]] = {}
    for part in batches(len(clips), sampling.samples, batch_size):
        members = [clips[i] for i in part]
        shown = np.stack([pictures[clip] for clip in members])
        answers = generate(base, shown, sampling, [seeds[clip] for clip in members])
        written |= {clip: [a.text for a in each] for clip, each in zip(members, answers, strict=True)}
    return written


def rank_pairs(answers: Mapping[int, Sequence[str]], judge: Judge, margin: float, most: int) -> list[Pair]:
    """The pairs of all clips; judge: the rewards of scenes of a clip, from its masks and flow alone."""
    pairs = []
    for clip, texts in answers.items():
        rewards = judge(clip, [read_completion(text).scene for text in texts])
        pairs += pairs_of(clip, texts, rewards.tolist(), margin, most)
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


@dataclass(frozen=True)
class _Example:
    """A pair as it is trained on, with the log-probabilities that the frozen reference gives."""

    better: ConstrainedTokens
    worse: ConstrainedTokens
    reference_better: float
    reference_worse: float
    picture: np.ndarray


def prefer(
    base: Base,
    pairs: Sequence[Pair],
    pictures: Mapping[int, np.ndarray],
    beta: float,
    sampling: Sampling,
    plan: TrainingPlan,
    work: Path,
    report: Report,
) -> None:
    """Train `base` in place on the pairs of clips (T, H, W, 3) uint8, with itself as it is now as the reference.

    work, report: as `train`; rows have loss, accuracy (share of pairs whose better completion has the higher implied
    reward) and margin (mean of the implied rewards' differences).
    """
    examples = _examples(base, pairs, pictures, sampling, plan.batch_size)

    def objective(batch: Sequence[_Example]) -> tuple[torch.Tensor, Mapping[str, float]]:
        better, worse = _both(base, batch)
        known = torch.tensor([(e.reference_better, e.reference_worse) for e in batch], device=better.device)
        margin = implicit_margin(better, worse, known[:, 0], known[:, 1], beta)
        implied = margin.detach()
        return dpo_loss(margin), {"accuracy": (implied > 0).float().mean().item(), "margin": implied.mean().item()}

    train(base, cast(Dataset, examples), list, objective, plan, work, report)


def _examples(
    base: Base, pairs: Sequence[Pair], pictures: Mapping[int, np.ndarray], sampling: Sampling, batch_size: int
) -> list[_Example]:
    def written(text: str) -> ConstrainedTokens:
        return constrained_tokens(base, text, sampling.reasoning, sampling.seconds)

    bare = [_Example(written(p.better), written(p.worse), 0.0, 0.0, pictures[p.clip]) for p in pairs]
    out: list[_Example] = []
    with torch.no_grad():
        for start in range(0, len(bare), batch_size):
            part = bare[start : start + batch_size]
            better, worse = (side.tolist() for side in _both(base, part))
            out += [
                replace(e, reference_better=b, reference_worse=w) for e, b, w in zip(part, better, worse, strict=True)
            ]
    return out


def _both(base: Base, batch: Sequence[_Example]) -> tuple[torch.Tensor, torch.Tensor]:
    """Log-probabilities (B,) of the better and of the worse completions, in one pass."""
    clips = torch.as_tensor(np.stack([e.picture for e in batch]))
    both = log_probabilities(base, [e.better for e in batch] + [e.worse for e in batch], clips.repeat(2, 1, 1, 1, 1))
    better, worse = both.chunk(2)
    return better, worse
