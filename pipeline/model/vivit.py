"""ViViT that regresses scenes from pictures of clips: the baseline without language.

A. Arnab et al., ViViT: A Video Vision Transformer (ICCV 2021), model 1 (attention over all tubelets of space and time).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional
from transformers import VivitConfig, VivitModel, VivitPreTrainedModel

from pipeline.errors import ModelError
from pipeline.model.checkpoint import LOADING_ERRORS, load_weights
from pipeline.model.scene_vector import CLASSES, HEAD, SLOT, SLOTS, Scale, SceneVector, decode, likeliest_shapes
from pipeline.model.trainer import ClipDataset, Report, train
from pipeline.model.training_plan import TrainingPlan
from pipeline.scene.scene import Scene

TUBELET = (2, 16, 16)  # frames, rows, columns of a token, as in the published ViViT-B/16x2
Example = tuple[np.ndarray, SceneVector]


@dataclass(frozen=True)
class VivitSize:
    """Pictures of width x height px, multiples of 16; width (hidden), depth and heads of the transformer."""

    width: int
    height: int
    frames: int
    hidden: int
    layers: int
    heads: int


@dataclass(frozen=True)
class Regressed:
    """head (B, 4) and numbers (B, SLOTS, 20) in [0, 1]; logits (B, SLOTS, 4) of the slots' CLASSES."""

    head: torch.Tensor
    logits: torch.Tensor
    numbers: torch.Tensor


class VivitRegressor(VivitPreTrainedModel):
    """ViViT's class token, and from it one linear layer to the vector of a scene."""

    def __init__(self, config: VivitConfig) -> None:
        super().__init__(config)
        self.vivit = VivitModel(config, add_pooling_layer=False)
        self.vector = nn.Linear(config.hidden_size, len(HEAD) + SLOTS * (len(CLASSES) + len(SLOT)))
        self.post_init()

    def forward(self, clips: torch.Tensor) -> Regressed:
        """Of clips (B, T, H, W, 3) uint8 in the size that the model was built for."""
        pixels = (clips.to(self.device).float() / 127.5 - 1).permute(0, 1, 4, 2, 3)
        out = self.vector(self.vivit(pixel_values=pixels).last_hidden_state[:, 0])
        head, slots = out[:, : len(HEAD)], out[:, len(HEAD) :].unflatten(1, (SLOTS, -1))
        return Regressed(head.sigmoid(), slots[..., : len(CLASSES)], slots[..., len(CLASSES) :].sigmoid())


@dataclass
class Regressor:
    """The model as the training loop takes it."""

    model: VivitRegressor


def build_regressor(size: VivitSize, seed: int) -> Regressor:
    """A model with random weights, float32."""
    torch.manual_seed(seed)
    config = VivitConfig(
        image_size=[size.height, size.width],
        num_frames=size.frames,
        tubelet_size=list(TUBELET),
        hidden_size=size.hidden,
        num_hidden_layers=size.layers,
        num_attention_heads=size.heads,
        intermediate_size=4 * size.hidden,
    )
    return Regressor(VivitRegressor(config))


def load_regressor(folder: Path) -> Regressor:
    """The model of a folder. Raises ModelError."""
    try:
        model = load_weights(VivitRegressor, folder)
    except LOADING_ERRORS as error:
        raise ModelError(
            f"{str(folder)!r} has no regressor ({str(error).splitlines()[0]}); `dvc repro` makes it"
        ) from None
    return Regressor(model.eval())


def picture_size(regressor: Regressor) -> tuple[int, int]:
    """Width and height, px, of the pictures that a model takes."""
    size = regressor.model.config.image_size
    assert not isinstance(size, int), "`build_regressor` gives height and width"
    height, width = size
    return width, height


def regression_loss(predicted: Regressed, truth: Sequence[SceneVector]) -> tuple[torch.Tensor, dict[str, float]]:
    """Cross-entropy of the slots, nats, plus the mean absolute error of the head and of the numbers that the objects
    have; and the two parts by name."""
    device = predicted.head.device
    shapes = torch.as_tensor(np.stack([v.shapes for v in truth]), device=device)
    head = torch.as_tensor(np.stack([v.head for v in truth]), dtype=predicted.head.dtype, device=device)
    numbers = torch.as_tensor(np.stack([v.numbers for v in truth]), dtype=predicted.head.dtype, device=device)
    present = torch.as_tensor(np.stack([v.present for v in truth]), device=device)
    slots = functional.cross_entropy(predicted.logits.flatten(0, 1), shapes.flatten())
    error = torch.cat([(predicted.head - head).flatten(), (predicted.numbers - numbers)[present]]).abs().mean()
    return slots + error, {"slots": slots.item(), "numbers": error.item()}


def regress(
    regressor: Regressor,
    clips: ClipDataset[Example],
    val: ClipDataset[Example],
    plan: TrainingPlan,
    work: Path,
    report: Report,
) -> None:
    """Train in place on pictures (T, H, W, 3) uint8 and vectors (`train` says what the rest means)."""

    def objective(batch: Sequence[Example]) -> tuple[torch.Tensor, Mapping[str, float]]:
        pictures = torch.as_tensor(np.stack([p for p, _ in batch]))
        return regression_loss(regressor.model(pictures), [v for _, v in batch])

    train(regressor, clips, list, objective, plan, work, report, val)


@torch.no_grad()
def answer(regressor: Regressor, clips: np.ndarray, scale: Scale) -> list[Scene]:
    """The scenes of clips (B, T, H, W, 3) uint8."""
    predicted = regressor.model.eval()(torch.as_tensor(clips))
    head, logits, numbers = (t.double().cpu().numpy() for t in (predicted.head, predicted.logits, predicted.numbers))
    return [decode(h, likeliest_shapes(k), n, scale) for h, k, n in zip(head, logits, numbers, strict=True)]
