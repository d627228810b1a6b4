from pathlib import Path

import numpy as np
import pytest
import torch
from small_base import random_clips, random_tokens, small_base

from pipeline.model.base import Base
from pipeline.model.finetune import batch_loss, finetune, make_batch
from pipeline.model.language.codec import Tokens
from pipeline.model.trainer import ClipDataset, last_checkpoint, write_hashes
from pipeline.model.training_plan import TrainingPlan


def plan(**values: object) -> TrainingPlan:
    given = {
        "steps": 8,
        "epochs": 1.0,
        "batch_size": 2,
        "learning_rate": 3e-3,
        "lora_rank": 0,
        "checkpoint_steps": 4,
        "seed": 3,
    } | values
    return TrainingPlan(**given)  # type: ignore[arg-type]


def examples(rng: np.random.Generator, base: Base, count: int) -> list[tuple[Tokens, np.ndarray]]:
    return [(random_tokens(rng, base), clip[None]) for clip in random_clips(rng, count)]


def dataset(rows: list[tuple[Tokens, np.ndarray]]) -> ClipDataset:
    return ClipDataset(len(rows), rows.__getitem__)


def weights(base: Base) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in base.model.parameters()])


@pytest.mark.parametrize("lora_rank", [0, 4])
def test_fine_tuning_lowers_the_loss_on_what_it_is_shown(
    rng: np.random.Generator, tmp_path: Path, lora_rank: int
) -> None:
    base = small_base()
    before = weights(base)
    rows = examples(rng, base, 2)
    curve: list[dict] = []
    rate = 3e-3 if not lora_rank else 3e-2
    finetune(
        base,
        dataset(rows),
        dataset(rows),
        plan(steps=16, learning_rate=rate, lora_rank=lora_rank, checkpoint_steps=8),
        tmp_path,
        curve.append,
    )
    losses = [row["eval_loss"] for row in curve if "eval_loss" in row]
    assert [row["step"] for row in curve if "eval_loss" in row] == [0, 8, 16]
    assert losses[-1] < losses[0] - 0.3
    assert weights(base).shape == before.shape
    assert not torch.equal(weights(base), before)
    batch = make_batch(base, [t for t, _ in rows], np.concatenate([c for _, c in rows]))
    with torch.no_grad():
        assert batch_loss(base, batch)[0].item() == pytest.approx(losses[-1], abs=0.02)
    assert not base.model.training


class PowerCut(Exception):
    pass


@pytest.mark.parametrize("lora_rank", [0, 2])
def test_an_interrupted_run_goes_on_and_ends_as_an_uninterrupted_one(
    rng: np.random.Generator, tmp_path: Path, lora_rank: int
) -> None:
    rows = examples(rng, small_base(), 6)
    whole, cut = small_base(), small_base()
    curve: list[dict] = []
    finetune(whole, dataset(rows), dataset(rows[:2]), plan(lora_rank=lora_rank), tmp_path / "whole", curve.append)

    def fail_at_six(row: dict) -> None:
        if row["step"] == 6:
            raise PowerCut

    with pytest.raises(PowerCut):
        finetune(cut, dataset(rows), dataset(rows[:2]), plan(lora_rank=lora_rank), tmp_path / "cut", fail_at_six)
    assert last_checkpoint(tmp_path / "cut") == tmp_path / "cut" / "checkpoint-4"
    again: list[dict] = []
    resumed = small_base()
    finetune(resumed, dataset(rows), dataset(rows[:2]), plan(lora_rank=lora_rank), tmp_path / "cut", again.append)
    torch.testing.assert_close(weights(resumed), weights(whole), atol=1e-5, rtol=1e-4)
    for key in ("loss", "eval_loss"):
        expected = [(row["step"], row[key]) for row in curve if key in row]
        assert [row["step"] for row in again if key in row] == [step for step, _ in expected], "the whole curve"
        np.testing.assert_allclose([row[key] for row in again if key in row], [v for _, v in expected], rtol=1e-3)


def test_a_checkpoint_that_was_not_written_to_its_end_is_passed_over(tmp_path: Path) -> None:
    assert last_checkpoint(tmp_path) is None
    for step in (4, 8, 12):
        (tmp_path / f"checkpoint-{step}").mkdir()
        (tmp_path / f"checkpoint-{step}" / "trainer_state.json").write_text("{}")
    for step in (4, 8):
        write_hashes(tmp_path / f"checkpoint-{step}")
    assert last_checkpoint(tmp_path) == tmp_path / "checkpoint-8"


@pytest.mark.parametrize("damage", [b"", b"z", b"ab"])
def test_of_a_damaged_checkpoint_the_one_before_is_used(tmp_path: Path, damage: bytes) -> None:
    for step in (4, 8):
        (tmp_path / f"checkpoint-{step}").mkdir()
        (tmp_path / f"checkpoint-{step}" / "optimizer.pt").write_bytes(b"a")
        write_hashes(tmp_path / f"checkpoint-{step}")
    (tmp_path / "checkpoint-8" / "optimizer.pt").write_bytes(damage)
    assert last_checkpoint(tmp_path) == tmp_path / "checkpoint-4"


def test_the_loss_is_the_cross_entropy_of_the_free_tokens_alone(rng: np.random.Generator) -> None:
    base = small_base()
    rows = examples(rng, base, 3)
    batch = make_batch(base, [t for t, _ in rows], np.concatenate([c for _, c in rows]))
    with torch.no_grad():
        loss, each = batch_loss(base, batch)
    labels = batch.labels[:, len(base.codec.prompt_ids) :]
    assert (each[labels == -100] == 0).all()
    assert (each[labels != -100] > 0).all()
    assert int((batch.labels != -100).sum()) == sum(int(t.free.sum()) for t, _ in rows)
    assert loss.item() == pytest.approx(each.sum().item() / int((labels != -100).sum()), rel=1e-5)
    assert loss.item() == pytest.approx(np.log(len(base.tokenizer)), rel=0.1), "untrained: all tokens alike"


def test_padding_does_not_change_the_loss_of_a_row(rng: np.random.Generator) -> None:
    base = small_base()
    short, long = sorted((random_tokens(rng, base), random_tokens(rng, base)), key=lambda t: len(t.ids))
    free, numeric = (np.concatenate([which, np.zeros(20, bool)]) for which in (long.free, long.numeric))
    longer = Tokens(np.concatenate([long.ids, long.ids[-20:]]), long.prompt_length, free, numeric)
    clips = random_clips(rng, 2)
    with torch.no_grad():
        _, alone = batch_loss(base, make_batch(base, [short], clips[:1]))
        _, padded = batch_loss(base, make_batch(base, [short, longer], clips))
    torch.testing.assert_close(padded[0, : alone.shape[1]], alone[0], atol=1e-4, rtol=1e-4)
