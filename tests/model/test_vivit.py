"""ViViT that regresses scenes, at a size for tests."""

from pathlib import Path

import numpy as np
import pytest
import torch
from sampled_scenes import distribution

from pipeline.model.scene_vector import CLASSES, SLOT, SLOTS, SceneVector, encode, scale_of
from pipeline.model.trainer import ClipDataset
from pipeline.model.training_plan import TrainingPlan
from pipeline.model.vivit import (
    Regressed,
    VivitSize,
    answer,
    build_regressor,
    load_regressor,
    picture_size,
    regress,
    regression_loss,
)
from pipeline.scene.sample import draw_scene

SIZE = VivitSize(width=32, height=16, frames=4, hidden=24, layers=2, heads=2)
SCALE = scale_of(distribution())


def random_clips(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(0, 256, (count, SIZE.frames, SIZE.height, SIZE.width, 3), dtype=np.uint8)


def random_vector(rng: np.random.Generator) -> SceneVector:
    return encode(draw_scene(rng, ["box", "sphere"], distribution()), SCALE)


def plan(steps: int) -> TrainingPlan:
    return TrainingPlan(
        steps=steps, epochs=1.0, batch_size=4, learning_rate=3e-3, lora_rank=0, checkpoint_steps=steps // 2, seed=1
    )


def test_training_on_a_few_clips_gets_their_shapes_right_and_goes_on_where_it_stopped(
    rng: np.random.Generator, tmp_path: Path
) -> None:
    shapes = [["sphere"], ["box", "cylinder"], ["cylinder"], ["box", "box", "sphere"]]
    clips = random_clips(rng, 4)
    vectors = [encode(draw_scene(rng, s, distribution()), SCALE) for s in shapes]
    data = ClipDataset(4, lambda i: (clips[i], vectors[i]))
    regressor = build_regressor(SIZE, int(rng.integers(1000)))
    rows: list[dict] = []
    regress(regressor, data, data, plan(60), tmp_path / "work", rows.append)
    losses = [row["eval_loss"] for row in rows if "eval_loss" in row]
    assert losses[-1] < 0.3 * losses[0]
    assert [row for row in rows if {"loss", "slots", "numbers"} <= set(row)]
    assert [s.shapes for s in answer(regressor, clips, SCALE)] == [tuple(s) for s in shapes]

    regressor.model.save_pretrained(tmp_path / "saved")
    again = load_regressor(tmp_path / "saved")
    assert picture_size(again) == (SIZE.width, SIZE.height)
    assert answer(again, clips, SCALE) == answer(regressor, clips, SCALE)
    resumed = build_regressor(SIZE, 0)
    regress(resumed, data, data, plan(60), tmp_path / "work", rows.append)
    assert answer(resumed, clips, SCALE) == answer(regressor, clips, SCALE)


def test_every_picture_of_a_clip_matters(rng: np.random.Generator) -> None:
    regressor = build_regressor(SIZE, int(rng.integers(1000)))
    clip = random_clips(rng, 1)
    before = regressor.model(torch.as_tensor(clip)).head
    for t in range(SIZE.frames):
        changed = clip.copy()
        changed[:, t] = random_clips(rng, 1)[:, 0]
        assert (regressor.model(torch.as_tensor(changed)).head - before).abs().max() > 1e-7


def told(rng: np.random.Generator, truth: SceneVector, certain: float = 0.0) -> Regressed:
    """What a model says that is right about everything but what a slot without an object has."""
    logits = certain * np.eye(len(CLASSES))[truth.shapes]
    numbers = np.where(truth.present, truth.numbers, rng.random(truth.numbers.shape))
    return Regressed(*(torch.as_tensor(v[None]) for v in (truth.head, logits, numbers)))


def test_the_loss_is_the_cross_entropy_of_slots_and_the_error_of_what_is_there(rng: np.random.Generator) -> None:
    truth = random_vector(rng)
    loss, parts = regression_loss(told(rng, truth), [truth])
    assert parts["slots"] == pytest.approx(np.log(len(CLASSES)), rel=1e-6)
    assert parts["numbers"] == pytest.approx(0, abs=1e-6)
    assert loss.item() == pytest.approx(sum(parts.values()))
    assert regression_loss(told(rng, truth, 50.0), [truth])[0].item() == pytest.approx(0, abs=1e-6)
    off = told(rng, truth)
    off.numbers[0, 0] += 0.25
    counted = len(truth.head) + truth.present.sum()
    assert regression_loss(off, [truth])[1]["numbers"] == pytest.approx(0.25 * len(SLOT) / counted, abs=1e-6)
    assert truth.present.shape == (SLOTS, len(SLOT))
