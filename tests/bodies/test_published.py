"""SAM 2 and EdgeTAM by local path, with random weights in the real format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from pipeline.bodies.networks.propagation import Prompt, body_prompts, packed, segment_with
from pipeline.bodies.networks.published_models import load_published, published_source
from pipeline.errors import ModelError
from tests.bodies.tiny_segmenters import save_edgetam, save_sam2

SAVE: dict[str, Callable[[Path], Path]] = {"sam2": save_sam2, "edgetam": save_edgetam}


@pytest.fixture(scope="module", params=sorted(SAVE))
def saved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    torch.manual_seed(0)
    return request.param, SAVE[request.param](tmp_path_factory.mktemp(request.param))


def two_bodies(count: int = 5, height: int = 60, width: int = 90) -> tuple[np.ndarray, np.ndarray]:
    """Frames of noise, and ids of two bodies; body 2 leaves the picture."""
    frames = np.random.default_rng(0).integers(0, 255, (count, height, width, 3), np.uint8)
    masks = np.zeros(frames.shape[:3], np.uint8)
    for t in range(count):
        masks[t, 20:30, 10 + 5 * t : 25 + 5 * t] = 1
        masks[t, 40:50, 60 + 9 * t : 72 + 9 * t] = 2
    return frames, masks


def test_bodies_that_are_prompted_by_masks_are_followed_over_the_whole_clip(saved: tuple[str, Path]) -> None:
    frames, masks = two_bodies()
    prompts = body_prompts(masks)
    found = segment_with(load_published(*saved), frames, prompts)
    assert found.shape == masks.shape
    assert found.dtype == np.uint8
    assert set(np.unique(found)) <= {0, 1, 2}
    for k, prompt in enumerate(prompts, 1):  # in its own frame, a body has the mask that was given
        assert prompt.mask is not None
        both, either = (found[prompt.frame] == k) & prompt.mask, (found[prompt.frame] == k) | prompt.mask
        assert both.sum() > 0.6 * either.sum()


def test_points_and_boxes_prompt_bodies_and_the_answer_is_the_same_twice(saved: tuple[str, Path]) -> None:
    frames, _ = two_bodies()
    segmenter = load_published(*saved)
    prompts = [
        Prompt(2, points=np.array([[22.0, 25.0]])),
        Prompt(0, box=np.array([60.0, 40.0, 71.0, 49.0])),
    ]
    first, again = (segment_with(segmenter, frames, prompts) for _ in range(2))
    assert first.shape == frames.shape[:3]
    assert np.array_equal(first, again)


def test_one_body_more_changes_another_one_only_where_they_meet(saved: tuple[str, Path]) -> None:
    frames, masks = two_bodies()
    segmenter, prompts = load_published(*saved), body_prompts(masks)
    alone, both = (segment_with(segmenter, frames, given) for given in (prompts[:1], prompts))
    assert ((both == 1) <= (alone == 1)).all()
    assert ((alone == 1) <= (both > 0)).all()


def test_without_prompts_there_are_no_bodies(saved: tuple[str, Path]) -> None:
    frames, _ = two_bodies()
    assert not segment_with(load_published(*saved), frames, []).any()


def test_a_body_is_prompted_where_it_is_large_and_free() -> None:
    masks = np.zeros((6, 40, 60), np.uint8)
    for t, side in enumerate((4, 8, 12, 12, 12, 20)):
        masks[t, 10 : 10 + side, 10 : 10 + side] = 1
    masks[2:4, 12:20, 23:30] = 2  # beside body 1 in frames 2 and 3
    masks[5, 10:30, 10:] = 1  # in the last frame it reaches the border
    first, second = body_prompts(masks)
    assert first.frame == 4
    assert second.frame in (2, 3)
    assert np.array_equal(first.mask, masks[4] == 1)


def test_frames_are_packed_as_imagenet_normalises_them() -> None:
    grey = np.full((2, 30, 40, 3), 128, np.uint8)
    pictures = packed(grey, (16, 16))
    assert pictures.shape == (2, 3, 16, 16)
    expected = (128 / 255 - np.array([0.485, 0.456, 0.406])) / np.array([0.229, 0.224, 0.225])
    assert np.allclose(pictures[0, :, 3, 5].numpy(), expected, atol=1e-5)


def test_a_prompt_has_either_a_mask_or_points_or_a_box() -> None:
    for given in ({}, {"mask": np.ones((2, 2), bool), "box": np.zeros(4)}):
        with pytest.raises(ValueError, match="either a mask"):
            Prompt(0, **given)


def test_half_precision_weights_are_used_in_float32(tmp_path: Path) -> None:
    torch.manual_seed(0)
    segmenter = load_published("sam2", save_sam2(tmp_path, torch.float16))
    assert {p.dtype for p in segmenter.model.parameters()} == {torch.float32}


def test_a_source_is_a_family_and_a_folder() -> None:
    assert published_source("sam2:some/folder") == ("sam2", Path("some/folder"))
    assert published_source("masks.npz") is None
    assert published_source("C:/masks") is None
    with pytest.raises(ModelError, match="names no folder"):
        published_source("edgetam:")


def test_a_hub_name_or_an_empty_folder_is_told_what_is_needed(tmp_path: Path) -> None:
    for place in ("facebook/sam2.1-hiera-tiny", tmp_path):
        with pytest.raises(ModelError, match=r"local folder with the config.json .* nothing is downloaded"):
            load_published("sam2", place)


def test_an_unknown_family_is_named() -> None:
    with pytest.raises(ModelError, match=r"unknown segmenter 'sam3'.*valid: sam2, edgetam"):
        load_published("sam3", "folder")


def test_weights_of_another_family_are_refused(saved: tuple[str, Path]) -> None:
    family, folder = saved
    other = next(f for f in SAVE if f != family)
    with pytest.raises(ModelError, match=f"of the type '{family}_video'; {other}:PATH takes"):
        load_published(other, folder)


def damaged(folder: Path, place: Path, change: Callable[[Path], None]) -> Path:
    place.mkdir()
    for file in folder.iterdir():
        (place / file.name).write_bytes(file.read_bytes())
    change(place)
    return place


def test_damaged_folders_are_refused(saved: tuple[str, Path], tmp_path: Path) -> None:
    family, folder = saved

    def halved(place: Path) -> None:
        weights = load_file(place / "model.safetensors")
        save_file(dict(list(weights.items())[::2]), place / "model.safetensors", {"format": "pt"})

    def cut(place: Path) -> None:
        file = place / "model.safetensors"
        file.write_bytes(file.read_bytes()[:-100])

    def other_size(place: Path) -> None:
        config = json.loads((place / "config.json").read_text())
        config["memory_fuser_intermediate_dim"] = 24
        (place / "config.json").write_text(json.dumps(config))

    def pickled(place: Path) -> None:
        torch.save(load_file(place / "model.safetensors"), place / "pytorch_model.bin")
        (place / "model.safetensors").unlink()

    changes: dict[str, Callable[[Path], None]] = {
        "are incomplete: .* are missing": halved,
        "cannot be loaded": cut,
        "cannot be loaded:": other_size,
        "has no config.json with safetensors": pickled,
        "is not the configuration of a model": lambda place: (place / "config.json").write_text("{}") and None,
    }
    for k, (message, change) in enumerate(changes.items()):
        with pytest.raises(ModelError, match=message):
            load_published(family, damaged(folder, tmp_path / str(k), change))


def test_edgetam_with_another_backbone_is_refused(tmp_path: Path) -> None:
    folder = save_edgetam(tmp_path)
    config = json.loads((folder / "config.json").read_text())
    config["vision_config"]["backbone_config"]["architecture"] = "resnet18"
    (folder / "config.json").write_text(json.dumps(config))
    with pytest.raises(ModelError, match=r"backbone is 'resnet18'; valid for EdgeTAM: 'repvit_m1'"):
        load_published("edgetam", folder)
