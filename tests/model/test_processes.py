"""Training in two processes (gloo): the steps of one, and a training that goes on after a kill."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from small_base import random_clips, random_tokens, small_base

from pipeline.errors import ModelError
from pipeline.model.base import Base
from pipeline.model.finetune import finetune
from pipeline.model.language.completion import write_completion
from pipeline.model.preference import Pair, prefer
from pipeline.model.processes import in_processes, is_first
from pipeline.model.sampling import Completed, Sampling
from pipeline.model.trainer import ClipDataset, last_checkpoint
from pipeline.model.training_plan import TrainingPlan
from pipeline.scene.scene import Camera, Scene, SceneObject

Trained = tuple[list[dict[str, Any]], torch.Tensor]


def plan(processes: int) -> TrainingPlan:
    return TrainingPlan(
        steps=4,
        epochs=1.0,
        batch_size=4,
        learning_rate=3e-3,
        lora_rank=0,
        checkpoint_steps=2,
        seed=3,
        processes=processes,
    )


def weights(base: Base) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in base.model.parameters()])


def fine_tuned(work: Path, processes: int, dies_at: int | None) -> Trained:
    """The work of each process; dies_at: the step at which the last one is killed."""
    base, rng = small_base(), np.random.default_rng(0)
    rows = [(random_tokens(rng, base), clip[None]) for clip in random_clips(rng, 8)]
    curve: list[dict[str, Any]] = []

    def report(row: dict[str, Any]) -> None:
        curve.append(row)
        if row["step"] == dies_at and not is_first():
            os.kill(os.getpid(), signal.SIGKILL)

    finetune(base, ClipDataset(8, rows.__getitem__), ClipDataset(4, rows.__getitem__), plan(processes), work, report)
    return curve, weights(base)


def preferred(work: Path, processes: int) -> Trained:
    base, rng = small_base(), np.random.default_rng(0)
    radii = rng.uniform(0.05, 0.3, 16).tolist()
    balls = [SceneObject("sphere", (r,), 1.0, position=(0, 0, 1)) for r in radii]
    texts = [write_completion(Scene((ball,), Camera((0, -2, 1), 40, pitch=-20)), [], 1.0) for ball in balls]
    pairs = [Pair(k, Completed(texts[k], 0.0), Completed(texts[k + 8], 0.0), 1.0) for k in range(8)]
    curve: list[dict[str, Any]] = []
    pictures = dict(enumerate(random_clips(rng, 8)))
    prefer(base, pairs, pictures, 0.1, Sampling(samples=2, seconds=1.0), plan(processes), work, curve.append)
    return curve, weights(base)


def curves(rows: list[dict[str, Any]]) -> dict[str, list[float]]:
    names = ("loss", "eval_loss", "accuracy", "margin")
    return {name: [row[name] for row in rows if name in row] for name in names}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return fine_tuned(tmp_path_factory.mktemp("alone"), 1, None)


def assert_same(trained: Trained, alone: Trained) -> None:
    found, expected = curves(trained[0]), curves(alone[0])
    assert len(expected["loss"]) == 4
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=2e-4, atol=1e-4)
    # AdamW's steps keep their size where the gradient is mere rounding, so that single weights may differ
    assert (trained[1] - alone[1]).norm() < 1e-3 * alone[1].norm()


@pytest.mark.slow
def test_two_processes_have_the_losses_and_the_weights_of_one_with_the_whole_batch(
    tmp_path: Path, alone: Trained
) -> None:
    assert_same(in_processes(fine_tuned, 2, tmp_path, 2, None), alone)


@pytest.mark.slow
def test_a_training_of_which_a_process_is_killed_goes_on_from_its_last_checkpoint(
    tmp_path: Path, alone: Trained
) -> None:
    with pytest.raises(ModelError, match="it goes on from its last checkpoint"):
        in_processes(fine_tuned, 2, tmp_path, 2, 3)
    assert last_checkpoint(tmp_path) == tmp_path / "checkpoint-2"
    assert_same(in_processes(fine_tuned, 2, tmp_path, 2, None), alone)


@pytest.mark.slow
def test_preference_optimisation_in_two_processes_is_that_of_one(tmp_path: Path) -> None:
    assert_same(in_processes(preferred, 2, tmp_path / "two", 2), preferred(tmp_path / "one", 1))
