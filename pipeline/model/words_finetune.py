"""Fine-tuning of the words model on the clips of the graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from pipeline.model.trainer import ClipDataset, Report, train
from pipeline.model.training_plan import TrainingPlan
from pipeline.model.words_example import Arrays, groups_of
from pipeline.model.words_loss import MIX, means
from pipeline.model.words_model import WordsModel


def finetune_words(
    model: WordsModel,
    clips: ClipDataset[Arrays],
    val: ClipDataset[Arrays],
    colours: bool,
    plan: TrainingPlan,
    work: Path,
    report: Report,
) -> None:
    """Train `model` in place on examples; colours: whether they show them. The rest as `finetune`."""

    def objective(rows: Sequence[Arrays]) -> tuple[torch.Tensor, Mapping[str, float]]:
        total = 0 * next(model.model.parameters()).sum()  # of a batch in which no body is seen
        for group in groups_of(rows):
            found = means(model.model, group, colours)
            each = sum((MIX[name] * value for name, value in found.items()), torch.zeros(()))
            total = total + each * len(group["ask"]) / len(rows)
        return total, {}

    train(model, clips, list, objective, plan, work, report, val)
