"""Checkpoints of trainings: the state comes back, and damage is never used."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.errors import ModelError
from training.checkpoint import before, has_checkpoint, load_checkpoint, save_checkpoint


def trained(steps: int) -> tuple[torch.nn.Module, torch.optim.Optimizer]:
    torch.manual_seed(0)
    model = torch.nn.Linear(3, 2)
    optimiser = torch.optim.AdamW(model.parameters())
    for _ in range(steps):
        optimiser.zero_grad()
        model(torch.ones(4, 3)).sum().backward()
        optimiser.step()
    return model, optimiser


def saved(path: Path, steps: int) -> None:
    model, optimiser = trained(steps)
    save_checkpoint(path, {"model": model.state_dict(), "optimisers": [optimiser.state_dict()], "step": steps})


def test_a_training_that_goes_on_from_a_checkpoint_is_the_one_that_was_not_stopped(tmp_path: Path) -> None:
    saved(tmp_path / "c.safetensors", 2)
    model, optimiser = trained(0)
    state = load_checkpoint(tmp_path / "c.safetensors")
    model.load_state_dict(state["model"])
    optimiser.load_state_dict(state["optimisers"][0])
    model(torch.ones(4, 3)).sum().backward()
    optimiser.step()
    assert state["step"] == 2
    whole = trained(3)[0].state_dict()
    assert all(torch.equal(value, whole[name]) for name, value in model.state_dict().items())


def test_what_is_in_a_state_comes_back_with_its_types(tmp_path: Path) -> None:
    state = {"a": [1, 2.5, None, "x", (True, torch.tensor(3, dtype=torch.bfloat16))], 7: torch.zeros(0, 4), "b": {}}
    save_checkpoint(tmp_path / "c.safetensors", state)
    again = load_checkpoint(tmp_path / "c.safetensors")
    assert again["a"][:4] == [1, 2.5, None, "x"] and again["a"][4] == (True, torch.tensor(3, dtype=torch.bfloat16))
    assert again[7].shape == (0, 4) and again["b"] == {}


def test_of_a_flipped_or_cut_checkpoint_the_one_before_is_used(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "c.safetensors"
    saved(path, 1)
    saved(path, 2)
    sound = path.read_bytes()
    assert load_checkpoint(path)["step"] == 2
    for _ in range(100):
        at = int(rng.integers(len(sound)))
        flipped = sound[:at] + bytes([sound[at] ^ (1 << int(rng.integers(8)))]) + sound[at + 1 :]
        path.write_bytes(flipped if rng.random() < 0.5 else sound[:at])
        step = load_checkpoint(path)["step"]
        warned = "is damaged" in capsys.readouterr().err
        assert (step == 1 and warned) or (step == 2 and path.read_bytes()[8:].strip() == sound[8:].strip())
    path.unlink()
    assert has_checkpoint(path) and load_checkpoint(path)["step"] == 1


def test_without_a_sound_checkpoint_there_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    saved(path, 1)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ModelError, match="no checkpoint before it"):
        load_checkpoint(path)
    before(path).write_bytes(b"")
    with pytest.raises(ModelError, match="the checkpoint before it are damaged"):
        load_checkpoint(path)
