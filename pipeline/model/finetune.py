"""Fine-tuning on tokenized clips: cross-entropy on the tokens of a completion that the grammar leaves free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from pipeline.model.base import Base
from pipeline.model.forward import hidden_states, right_padded
from pipeline.model.language.codec import Tokens
from pipeline.model.processes import share_of_mean
from pipeline.model.trainer import ClipDataset, Report, train
from pipeline.model.training_plan import TrainingPlan

Example = tuple[Tokens, np.ndarray]  # with the videos (S, T, H, W, 3) uint8 that its prompt shows


@dataclass
class Batch:
    """ids (B, L), labels (B, L) with -100 where nothing is learned, videos (V, T, H, W, 3) uint8 of all rows; start:
    length of the shortest prompt."""

    ids: torch.Tensor
    labels: torch.Tensor
    videos: torch.Tensor
    start: int


def make_batch(base: Base, tokens: Sequence[Tokens], videos: np.ndarray) -> Batch:
    """Tokens of prompts and completions with the videos that they show, as one batch.

    Only what the grammar leaves free carries a label.
    """
    ids = right_padded([t.ids for t in tokens], base.codec.pad_id)
    labels = torch.full_like(ids, -100)
    for i, t in enumerate(tokens):
        labels[i, : len(t.ids)][torch.as_tensor(t.free)] = torch.as_tensor(t.ids[t.free], dtype=torch.long)
    return Batch(ids, labels, torch.as_tensor(videos), min(t.prompt_length for t in tokens))


def completion_logits(base: Base, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """Logits (B, L - P, V) and labels (B, L - P) of the tokens after the shortest prompt (P)."""
    prompt = batch.start
    hidden = hidden_states(base, batch.ids, batch.videos)
    return base.model.lm_head(hidden[:, prompt - 1 : -1]).float(), batch.labels.to(base.model.device)[:, prompt:]


def batch_loss(base: Base, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean loss of a batch and the loss of every token (B, L - P), nats, 0 where there is no label."""
    logits, targets = completion_logits(base, batch)
    each = functional.cross_entropy(logits.flatten(0, 1), targets.flatten(), ignore_index=-100, reduction="none")
    each = each.view_as(targets)
    return each.sum() / (targets != -100).sum(), each.detach()


def finetune(
    base: Base, clips: ClipDataset[Example], val: ClipDataset[Example], plan: TrainingPlan, work: Path, report: Report
) -> None:
    """Train `base` in place on the clips' completions (`train` says what the rest means); report: step, loss or
    eval_loss (on val), learning_rate."""

    def collate(rows: Sequence[Example]) -> Batch:
        return make_batch(base, [tokens for tokens, _ in rows], np.concatenate([videos for _, videos in rows]))

    def objective(batch: Batch) -> tuple[torch.Tensor, Mapping[str, float]]:
        loss = batch_loss(base, batch)[0]
        return share_of_mean(loss, int((batch.labels != -100).sum())), {}

    train(base, clips, collate, objective, plan, work, report, val)
