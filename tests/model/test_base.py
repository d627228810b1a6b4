import json
from pathlib import Path

import numpy as np
import pytest
import torch
from small_base import INPUT, LAYOUT, random_clips, random_tokens, small_base
from transformers import GPT2Config

from pipeline.errors import ModelError
from pipeline.model.answering import load_answering
from pipeline.model.checkpoint import load_tokenizer, read_layout
from pipeline.model.finetune import batch_loss, make_batch


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model") / "small"
    small_base().save(folder)
    return folder


def test_what_is_saved_is_loaded_the_same(rng: np.random.Generator, saved: Path) -> None:
    base, again = small_base(), load_answering(str(saved), frames=LAYOUT.frames)
    assert (again.layout, again.input, again.name) == (LAYOUT, INPUT, str(saved))
    assert again.codec.prompt_ids == base.codec.prompt_ids
    batch = make_batch(base, [random_tokens(rng, base)], random_clips(rng, 1))
    with torch.no_grad():
        torch.testing.assert_close(batch_loss(again, batch)[0], batch_loss(base, batch)[0])
    assert {f.name for f in saved.iterdir()} >= {
        "model.safetensors",
        "config.json",
        "tokenizer.json",
        "clip_layout.json",
        "model_input.json",
    }


def test_the_fast_patch_embedding_is_the_convolution(rng: np.random.Generator) -> None:
    embed = small_base().model.model.visual.patch_embed
    patches = torch.as_tensor(rng.normal(size=(5, 3 * 2 * 16 * 16)), dtype=torch.float32)
    torch.testing.assert_close(embed(patches), type(embed).forward(embed, patches), atol=1e-4, rtol=1e-4)


def test_a_checkpoint_without_a_layout_takes_the_frames_of_the_parameters(saved: Path, tmp_path: Path) -> None:
    for file in saved.iterdir():
        if file.name != "clip_layout.json":
            (tmp_path / file.name).symlink_to(file)
    layout = read_layout(str(tmp_path), 96, 64, 6)
    assert (layout.width, layout.height, layout.frames, layout.patch) == (96, 64, 6, 16)
    with pytest.raises(ModelError, match="multiples of 32 px, not 100 x 64"):
        read_layout(str(tmp_path), 100, 64, 6)


@pytest.mark.parametrize("name", ["models/nowhere", "Qwen/Qwen2.5-VL-3B-Instruct-that-nobody-has"])
def test_a_model_that_is_not_there_is_told_how_to_get(name: str) -> None:
    for load in (load_answering, load_tokenizer):
        with pytest.raises(ModelError, match=rf"^'{name}'.*Valid: models/words, or fetch .*hf download") as caught:
            load(name)
        assert "\n" not in str(caught.value)


def test_a_folder_that_is_no_checkpoint_or_a_damaged_one_is_refused(saved: Path, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"neither a folder with a Qwen2\.5-VL checkpoint"):
        load_answering(str(tmp_path))
    for file in saved.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "model.safetensors").write_bytes(b"\0" * 40)
    with pytest.raises(ModelError, match="neither a folder"):
        load_answering(str(tmp_path), frames=LAYOUT.frames)
    (tmp_path / "clip_layout.json").write_text('{"width": 3}')
    with pytest.raises(ModelError, match="neither a folder"):
        load_answering(str(tmp_path), frames=LAYOUT.frames)


def test_another_architecture_is_refused_instead_of_filled_with_random_weights(saved: Path, tmp_path: Path) -> None:
    for file in saved.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    GPT2Config(n_embd=8, n_layer=1, n_head=1).save_pretrained(tmp_path)
    with pytest.raises(ModelError, match="of the type gpt2, not qwen2_5_vl"):
        load_answering(str(tmp_path), frames=LAYOUT.frames)


def test_another_number_of_frames_than_it_was_trained_on_is_refused(saved: Path) -> None:
    with pytest.raises(ModelError, match="was trained on 4 frames a clip; 10 cannot"):
        load_answering(str(saved), frames=10)


def test_the_layout_file_is_plain_json(saved: Path) -> None:
    assert json.loads((saved / "clip_layout.json").read_text())["width"] == LAYOUT.width
