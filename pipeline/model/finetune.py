"""Fine-tuning on tokenized clips."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from pipeline.language.codec import Tokens
from pipeline.model.base import Base
from pipeline.model.loss import Batch, batch_loss, make_batch
from pipeline.model.trainer import Report, TrainingPlan, train


class ClipDataset(Dataset):
    """Clips as (tokens, pictures (T, H, W, 3) uint8), read when asked for."""

    def __init__(self, length: int, read: Callable[[int], tuple[Tokens, np.ndarray]]) -> None:
        self._length, self._read = length, read

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> dict[str, Any]:
        tokens, picture = self._read(index)
        return {"tokens": tokens, "picture": picture}


def finetune(base: Base, clips: ClipDataset, val: ClipDataset, plan: TrainingPlan, work: Path, report: Report) -> None:
    """Train `base` in place on the clips' completions (`train` says what the rest means); report: step, loss or
    eval_loss (on val), learning_rate."""

    def collate(rows: Sequence[dict[str, Any]]) -> Batch:
        return make_batch(base, [r["tokens"] for r in rows], np.stack([r["picture"] for r in rows]))

    def objective(batch: Batch) -> tuple[torch.Tensor, Mapping[str, float]]:
        return batch_loss(base, batch)[0], {}

    train(base, clips, collate, objective, plan, work, report, val)
