"""The tiny model in training: weights, optimisers, progress."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pipeline.language.codec import Codec
from pipeline.language.tokenizer import build_tokenizer
from pipeline.model.base import Base, load_base
from pipeline.model.finetune import batch_loss, completion_logits, make_batch
from pipeline.model.forward import video_inputs
from pipeline.model.tiny import TinySize, build_tiny
from pipeline.scene.scene import BASIC_SHAPES
from training.checkpoint import load_checkpoint, save_checkpoint
from training.muon import Muon
from training.tiny.examples import CHUNK, LAYOUT, Example
from training.tiny.patch_labels import PatchHead, PatchLabels
from training.tiny.soft_numbers import soft_loss

LOG = "log.csv"  # of losses, in the work folder and beside the weights


@dataclass
class Progress:
    """How far a training is.

    Attributes:
        step: Optimiser steps.
        vision_steps: Those of the vision tower only, among them.
        seconds: Of training.
        chunk: The first chunk of clips that is not made yet.
    """

    step: int = 0
    vision_steps: int = 0
    seconds: float = 0.0
    chunk: int = 0


def new_base() -> Base:
    """The tiny model with random weights, always the same."""
    tokenizer = build_tokenizer()
    return Base(build_tiny(tokenizer, TinySize(), seed=0), tokenizer, LAYOUT, Codec(tokenizer, LAYOUT.tokens))


def read_checkpoint(path: Path) -> tuple[Base, Progress]:
    """The model of a checkpoint that a `Trainer` saved, for answering, and its progress."""
    stored = load_checkpoint(path)
    base = new_base()
    base.model.load_state_dict(stored["model"])
    base.model.eval()
    return base, Progress(**{f.name: stored[f.name] for f in fields(Progress)})


def progress_of_row(row: dict[str, str], batch: int) -> Progress:
    """How far a training was at a row of its log."""
    return Progress(
        step=int(row["clips"]) // batch, seconds=60 * float(row["minutes"]), chunk=int(row["fresh_clips"]) // CHUNK
    )


class Trainer:
    """The model, with random weights until `load` or `start_from`, and its optimisers.

    patch_weight: weight of the loss on patch labels beside the completion's.
    """

    def __init__(self, device: str, rate: float, muon_rate: float, patch_weight: float) -> None:
        self.base, self.progress, self.patch_weight = new_base(), Progress(), patch_weight
        model: Any = self.base.model
        model.to(device)
        if device == "cpu":
            model.set_attn_implementation("eager")  # faster here than the fused kernel, which does many small products
        self.device = device
        self.head = PatchHead(model.config.text_config.hidden_size, LAYOUT).to(device)
        self.optimizers = make_optimizers(self.base, self.head, rate, muon_rate)
        self.peaks = [group["lr"] for optimizer in self.optimizers for group in optimizer.param_groups]
        self.tokens = torch.empty(0)  # the vision tower's, of the last forward pass
        model.model.visual.register_forward_hook(self._keep_tokens)
        model.train()

    def _keep_tokens(self, module: torch.nn.Module, inputs: Any, output: Any) -> None:
        self.tokens = output.pooler_output

    def start_from(self, folder: Path, clips: Iterable[tuple[np.ndarray, list[PatchLabels]]]) -> None:
        """Take the weights of a model saved for answering, and train only a new head on patch labels.

        clips: batches of pictures and labels, as `learn_patches` takes them.
        """
        self.base.model.load_state_dict(load_base(str(folder)).model.state_dict())
        optimizer = torch.optim.AdamW(self.head.parameters(), 3e-3)
        for pictures, labels in clips:
            with torch.no_grad():
                tokens = self.vision_tokens(torch.as_tensor(pictures))
            optimizer.zero_grad()
            self.head(tokens, labels).backward()
            optimizer.step()

    def load(self, path: Path) -> None:
        """Continue from a checkpoint."""
        stored = load_checkpoint(path, self.device)
        self.base.model.load_state_dict(stored.pop("model"))
        self.head.load_state_dict(stored.pop("head"))
        for optimizer, kept in zip(self.optimizers, stored.pop("optimizers"), strict=True):
            optimizer.load_state_dict(kept)
        self.progress = Progress(**stored)

    def save(self, path: Path) -> None:
        """Write a checkpoint for `load`."""
        weights = {
            "model": self.base.model.state_dict(),
            "head": self.head.state_dict(),
            "optimizers": [o.state_dict() for o in self.optimizers],
        }
        save_checkpoint(path, weights | asdict(self.progress))

    def vision_tokens(self, clips: torch.Tensor) -> torch.Tensor:
        """The vision tower's tokens (B * tokens, hidden) of clips (B, T, H, W, 3) uint8."""
        patches, grid = video_inputs(self.base, clips)
        return self.base.model.model.visual(patches, grid_thw=grid).pooler_output

    def learn_patches(self, pictures: np.ndarray, labels: list[PatchLabels], share: float) -> tuple[float, float]:
        """One step of the vision tower only, at a share of the peak rates.

        Returns 0, in the place of a completion's loss, and the loss of the patches, nats.
        """
        with self.precision():
            patch_loss = self.head(self.vision_tokens(torch.as_tensor(pictures)), labels)
        self.progress.vision_steps += 1
        return self.step(torch.zeros((), device=self.device), patch_loss, share)

    def learn(self, examples: list[Example], share: float) -> tuple[float, float]:
        """One step of the whole model. Returns the losses of the completions and of the patches, nats."""
        with self.precision():
            batch = make_batch(self.base, [e.tokens for e in examples], np.stack([e.picture for e in examples]))
            logits, labels = completion_logits(self.base, batch)
            prompt = len(self.base.codec.prompt_ids)
            loss = soft_loss(logits.log_softmax(-1), labels, [e.soft for e in examples], prompt)
            patch_loss = self.head(self.tokens, [e.patches for e in examples])
        return self.step(loss, patch_loss, share)

    def precision(self) -> torch.autocast:
        return torch.autocast(self.device, torch.bfloat16, enabled=self.device == "cuda")

    def step(self, loss: torch.Tensor, patch_loss: torch.Tensor, share: float) -> tuple[float, float]:
        groups = [group for optimizer in self.optimizers for group in optimizer.param_groups]
        for group, peak in zip(groups, self.peaks, strict=True):
            group["lr"] = share * peak
        for optimizer in self.optimizers:
            optimizer.zero_grad()
        (loss + self.patch_weight * patch_loss).backward()
        torch.nn.utils.clip_grad_norm_([*self.base.model.parameters(), *self.head.parameters()], 1.0)
        for optimizer in self.optimizers:
            optimizer.step()
        self.progress.step += 1
        return loss.item(), patch_loss.item()

    @torch.no_grad()
    def validate(self, examples: list[Example], batch_size: int) -> dict[str, float]:
        """Mean losses of held-out examples.

        Of free tokens, and of the shapes and numbers among them, nats; and the share of the patches on objects whose
        shape the vision tower predicts right.
        """
        base = self.base
        base.model.eval()
        shape_ids = torch.tensor([base.tokenizer.convert_tokens_to_ids(s) for s in BASIC_SHAPES])
        prompt = len(base.codec.prompt_ids)
        sums = {"loss": [0.0, 0], "shape_loss": [0.0, 0], "number_loss": [0.0, 0]}
        for start in range(0, len(examples), batch_size):
            chosen = examples[start : start + batch_size]
            batch = make_batch(base, [e.tokens for e in chosen], np.stack([e.picture for e in chosen]))
            each = batch_loss(base, batch)[1].float().cpu()
            labels = batch.labels[:, prompt:]
            numeric = torch.zeros_like(labels, dtype=torch.bool)
            for i, e in enumerate(chosen):
                numeric[i, : len(e.tokens.ids) - prompt] = torch.as_tensor(e.tokens.numeric[prompt:])
            parts = (labels != -100, torch.isin(labels, shape_ids), numeric)
            for key, which in zip(sums, parts, strict=True):
                sums[key][0] += float(each[which].sum())
                sums[key][1] += int(which.sum())
        base.model.train()
        tokens = self.vision_tokens(torch.as_tensor(np.stack([e.picture for e in examples])))
        right = self.head.shapes_right(tokens, [e.patches for e in examples])
        return {key: total / max(count, 1) for key, (total, count) in sums.items()} | {"shapes_right": right}


def make_optimizers(base: Base, head: PatchHead, rate: float, muon_rate: float) -> list[torch.optim.Optimizer]:
    """Muon for the matrices between hidden features, AdamW for the rest."""
    visual, language = base.model.model.visual, base.model.model.language_model
    inner = [*visual.blocks.parameters(), *visual.merger.parameters(), *language.layers.parameters()]
    hidden = [p for p in inner if p.ndim == 2]
    chosen = {id(p) for p in hidden}
    rest = [p for p in [*base.model.parameters(), *head.parameters()] if id(p) not in chosen]
    return [
        Muon(hidden, muon_rate, weight_decay=0.05),
        torch.optim.AdamW(rest, rate, betas=(0.9, 0.95), weight_decay=0.05),
    ]
