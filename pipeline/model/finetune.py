"""Fine-tuning on tokenized clips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from pipeline.language.codec import Tokens
from pipeline.model.base import Base
from pipeline.model.clip_dataset import ClipDataset
from pipeline.model.loss import Batch, batch_loss, make_batch
from pipeline.model.trainer import Report, TrainingPlan, train

Example = tuple[Tokens, np.ndarray]  # with pictures (T, H, W, 3) uint8


def finetune(
    base: Base, clips: ClipDataset[Example], val: ClipDataset[Example], plan: TrainingPlan, work: Path, report: Report
) -> None:
    """Train `base` in place on the clips' completions (`train` says what the rest means); report: step, loss or
    eval_loss (on val), learning_rate."""

    def collate(rows: Sequence[Example]) -> Batch:
        return make_batch(base, [tokens for tokens, _ in rows], np.stack([picture for _, picture in rows]))

    def objective(batch: Batch) -> tuple[torch.Tensor, Mapping[str, float]]:
        return batch_loss(base, batch)[0], {}

    train(base, clips, collate, objective, plan, work, report, val)
