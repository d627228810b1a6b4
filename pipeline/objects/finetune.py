"""Fine-tuning of the model that reads objects on the clips of the graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from torch import Tensor

from pipeline.model.trainer import ClipDataset, Report, train
from pipeline.model.training_plan import TrainingPlan
from pipeline.objects.answering import ObjectsModel
from pipeline.objects.batch import Group, groups_of, joined, loss_sums, mean_losses, total
from pipeline.objects.example import Example


def finetune_objects(
    model: ObjectsModel,
    clips: ClipDataset[Example],
    val: ClipDataset[Example],
    plan: TrainingPlan,
    work: Path,
    report: Report,
) -> None:
    """Train `model` in place on examples; as `pipeline.model.finetune.finetune`."""
    rng = np.random.default_rng(plan.seed)

    def collate(rows: Sequence[Example]) -> list[Group]:
        return list(groups_of(joined(rows), np.arange(len(rows))))

    def objective(groups: list[Group]) -> tuple[Tensor, Mapping[str, float]]:
        means = mean_losses(groups, [loss_sums(model.model, group, rng) for group in groups])
        return total(means), {}

    train(model, clips, collate, objective, plan, work, report, val)
