"""The training of the tiny model, on a few clips."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.language.codec import Codec
from pipeline.language.tokenizer import build_tokenizer
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.tiny.examples import LAYOUT, Example, ExampleKind, make_examples
from training.tiny.trainer import Trainer, progress_of_row, read_checkpoint


@pytest.fixture
def examples(rng: np.random.Generator) -> list[Example]:
    params = read_params_file(PARAMS_FILE, Params).model_copy(update={"seed": int(rng.integers(2**31))})
    return make_examples(params, Codec(build_tokenizer(), LAYOUT.tokens), ExampleKind(), "test", range(4), False)


def test_a_training_learns_and_continues_from_its_checkpoint(examples: list[Example], tmp_path: Path) -> None:
    trainer = Trainer("cpu", 1.5e-3, 4e-3, 0.5)
    losses = [trainer.learn(examples, share=1.0)[0] for _ in range(8)]
    assert losses[-1] < losses[0] - 0.3
    trainer.save(tmp_path / "checkpoint.safetensors")
    again = Trainer("cpu", 1.5e-3, 4e-3, 0.5)
    again.load(tmp_path / "checkpoint.safetensors")
    assert again.progress == trainer.progress and again.progress.step == 8
    assert again.validate(examples, 4) == pytest.approx(trainer.validate(examples, 4), rel=1e-5)
    assert again.learn(examples, share=1.0) == pytest.approx(trainer.learn(examples, share=1.0), rel=1e-4)


def test_a_training_starts_from_a_model_without_a_head(examples: list[Example], tmp_path: Path) -> None:
    trainer = Trainer("cpu", 1.5e-3, 4e-3, 0.5)
    for _ in range(2):
        trainer.learn(examples, share=1.0)
    trainer.base.save(tmp_path)
    started = Trainer("cpu", 1.5e-3, 4e-3, 0.5)
    batch = np.stack([e.picture for e in examples]), [e.patches for e in examples]
    started.start_from(tmp_path, [batch] * 30)
    for mine, theirs in zip(started.base.model.parameters(), trainer.base.model.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs)
    with torch.no_grad():
        tokens = started.vision_tokens(torch.as_tensor(batch[0]))
        trained, untrained = started.head(tokens, batch[1]), Trainer("cpu", 1e-3, 1e-3, 0.5).head(tokens, batch[1])
    assert trained < untrained - 0.5


def test_the_progress_of_a_training_is_read_from_its_log() -> None:
    progress = progress_of_row({"clips": "800", "minutes": "1.5", "fresh_clips": "640"}, 8)
    assert (progress.step, progress.seconds, progress.chunk, progress.vision_steps) == (100, 90.0, 40, 0)


def test_a_checkpoint_is_read_as_a_model_that_answers(examples: list[Example], tmp_path: Path) -> None:
    trainer = Trainer("cpu", 1e-3, 1e-3, 0.5)
    trainer.save(tmp_path / "checkpoint.safetensors")
    base, progress = read_checkpoint(tmp_path / "checkpoint.safetensors")
    assert progress == trainer.progress
    for mine, theirs in zip(base.model.parameters(), trainer.base.model.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs)
