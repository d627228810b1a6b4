"""Train the network for outlines on squares that `training.segmentation.outline_examples` made.

    python -m training.segmentation.train_outlines EXAMPLES OUT --minutes 30 [--threads 1]

The mask that the network is shown is the exact one, moved, scaled, bent, cut, or joined with something of its own shape
as a shadow would be. The learning rate falls to nothing over --minutes. OUT gets the weights in the shipped form. The
last HELD examples are held out, and their IoU is printed beside that of the mask that was shown.
"""

from __future__ import annotations

import math

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from pipeline.bodies.networks.outline_network import SIDE, OutlineNetwork, save_outline_network
from pipeline.bodies.networks.outlines import input_of
from training.segmentation.kept_arrays import load_arrays
from training.segmentation.outline_examples import OutlineExamples
from training.segmentation.timed_training import read_arguments, train_for

BATCH, RATE, DECAY = 64, 3e-3, 1e-4
HELD = 512
SHADOWED, CUT = 0.3, 0.2  # share of the masks that have what is no body, or lack a part
BENT_PX, SHIFT_PX, SCALE = 2.5, 1.5, 0.12  # standard deviations, of SIDE; of the scale's logarithm


def degraded(mask: Tensor, generator: torch.Generator) -> Tensor:
    """Masks (B, SIDE, SIDE) in [0, 1] as a network might find them: 0 or 1."""
    count = len(mask)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    line = torch.linspace(-1, 1, SIDE)
    rows, columns = torch.meshgrid(line, line, indexing="ij")
    plain = torch.stack([columns, rows], -1)[None]
    px = 2 / SIDE
    coarse = normal(count, 2, 6, 6) * BENT_PX * px * uniform(count, 1, 1, 1) * 2
    bend = F.interpolate(coarse, (SIDE, SIDE), mode="bicubic", align_corners=False).permute(0, 2, 3, 1)
    scale = torch.exp(SCALE * normal(count, 1, 1, 1))
    grid = plain * scale + SHIFT_PX * px * normal(count, 1, 1, 2) + bend
    out = F.grid_sample(mask[:, None], grid, mode="bilinear", align_corners=False)[:, 0] > 0.5
    squash = torch.exp(0.4 * normal(count, 1, 1, 2))
    away = (plain + 16 * px * normal(count, 1, 1, 2)) * squash
    cast = F.grid_sample(mask[:, None], away, mode="bilinear", align_corners=False)[:, 0] > 0.5
    out |= cast & (uniform(count, 1, 1) < SHADOWED)
    angle = 2 * math.pi * uniform(count, 1, 1)
    side = columns * angle.cos() + rows * angle.sin() > 0.6 * uniform(count, 1, 1)
    out &= ~(side & (uniform(count, 1, 1) < CUT))
    return out.float()


def batch_of(
    examples: OutlineExamples, chosen: np.ndarray, generator: torch.Generator, augment: bool
) -> tuple[Tensor, Tensor, Tensor]:
    """Input (B, INPUTS, SIDE, SIDE), exact masks and masks that are shown, both (B, SIDE, SIDE), of some examples."""

    def pictures(values: np.ndarray) -> Tensor:
        return torch.from_numpy(values[chosen]).permute(0, 3, 1, 2).float() / 255

    def masks(values: np.ndarray) -> Tensor:
        return torch.from_numpy(values[chosen]).float() / 255

    frame, plate = pictures(examples.frame), pictures(examples.plate)
    known, others, mask = masks(examples.known), masks(examples.others), masks(examples.mask)
    if augment:
        gain = torch.exp(0.15 * torch.randn(len(chosen), 3, 1, 1, generator=generator))
        order = torch.randperm(3, generator=generator)
        frame, plate = (frame * gain)[:, order].clamp(0, 1), (plate * gain)[:, order].clamp(0, 1)
        if torch.rand(1, generator=generator) < 0.5:
            frame, plate, known, others, mask = (x.flip(-1) for x in (frame, plate, known, others, mask))
        if torch.rand(1, generator=generator) < 0.2:
            frame, plate, known, others, mask = (x.flip(-2) for x in (frame, plate, known, others, mask))
    shown = degraded(mask, generator)
    return input_of(frame, plate, torch.stack([known, shown, others], 1)), mask, shown


def iou(found: Tensor, true: Tensor) -> float:
    """Mean overlap of masks (B, SIDE, SIDE), cut at 0.5."""
    one, other = found > 0.5, true > 0.5
    both = (one & other).sum((1, 2)).float()
    return float((both / (one | other).sum((1, 2)).clamp(min=1)).mean())


def loss_of(logits: Tensor, mask: Tensor) -> Tensor:
    """Cross entropy and one less Dice's overlap, of logits and masks (B, SIDE, SIDE)."""
    soft = logits.sigmoid()
    dice = (2 * (soft * mask).sum((1, 2)) + 1) / ((soft + mask).sum((1, 2)) + 1)
    return F.binary_cross_entropy_with_logits(logits, mask) + 0.5 * (1 - dice).mean()


def main() -> None:
    arguments = read_arguments(__doc__, minutes=30)
    generator, rng = torch.Generator().manual_seed(arguments.seed), np.random.default_rng(arguments.seed)
    examples = load_arrays(arguments.examples, OutlineExamples)
    held = np.arange(len(examples.frame) - HELD, len(examples.frame))
    print(f"{len(examples.frame)} examples", flush=True)
    network, averaged = OutlineNetwork(), OutlineNetwork()

    def draw() -> tuple[Tensor, Tensor]:
        chosen = np.sort(rng.choice(len(examples.frame) - HELD, BATCH, replace=False))
        shown, mask, _ = batch_of(examples, chosen, generator, augment=True)
        return shown, mask

    def report(step: int, minutes: float, loss: float) -> None:
        test, mask, before = batch_of(examples, held, torch.Generator().manual_seed(1), augment=False)
        with torch.inference_mode():
            found = averaged(test)
        print(
            f"step {step}, {minutes:.1f} min: loss {loss:.4f}; held out: loss {float(loss_of(found, mask)):.4f}, "
            f"IoU {iou(found.sigmoid(), mask):.4f} for {iou(before, mask):.4f}",
            flush=True,
        )
        config = {"steps": step, "examples": len(examples.frame), "minutes": round(minutes, 1)}
        save_outline_network(averaged, arguments.out, config)

    train_for(arguments, network, averaged, rate=RATE, decay=DECAY, draw=draw, loss_of=loss_of, report=report)


if __name__ == "__main__":
    main()
