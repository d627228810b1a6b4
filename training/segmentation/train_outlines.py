"""Train the network for outlines on squares that `training.segmentation.outline_examples` made.

    python -m training.segmentation.train_outlines EXAMPLES OUT --minutes 30 [--threads 1]

The mask that the network is shown is the exact one, moved, scaled, bent, cut, or joined with something of its own shape
as a shadow would be. The learning rate falls to nothing over --minutes. OUT gets the weights in the shipped form. The
last HELD examples are held out, and their IoU is printed beside that of the mask that was shown.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from pipeline.segmentation.outline_network import SIDE, OutlineNetwork, save_outline_network
from pipeline.segmentation.outlines import input_of
from training.segmentation.outline_examples import OutlineExamples
from training.segmentation.train import average_weights, learning_rate

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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--bfloat16", action="store_true", help="twice as fast where the processor has AMX")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    generator = torch.Generator().manual_seed(arguments.seed)
    with np.load(arguments.examples) as archive:
        examples = OutlineExamples(**{k: archive[k] for k in archive.files})
    held = np.arange(len(examples.frame) - HELD, len(examples.frame))
    network = OutlineNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    print(f"{len(examples.frame)} examples, {sum(p.numel() for p in network.parameters())} parameters", flush=True)
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    averaged = OutlineNetwork().eval()
    averaged.load_state_dict(network.state_dict())
    rng, start, step, losses = np.random.default_rng(arguments.seed), time.monotonic(), 0, []
    while (share := (time.monotonic() - start) / (60 * arguments.minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = RATE * learning_rate(step, share)
        chosen = np.sort(rng.choice(len(examples.frame) - HELD, BATCH, replace=False))
        shown, mask, _ = batch_of(examples, chosen, generator, augment=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=arguments.bfloat16):
            logits = network.train()(shown.contiguous(memory_format=torch.channels_last))
        loss = loss_of(logits.float(), mask)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        step += 1
        average_weights(averaged.state_dict(), network, step)
        losses.append(loss.item())
        if step % 250 == 0 or time.monotonic() - start >= 60 * arguments.minutes:
            minutes = (time.monotonic() - start) / 60
            test, mask, before = batch_of(examples, held, torch.Generator().manual_seed(1), augment=False)
            with torch.inference_mode():
                found = averaged(test)
            print(
                f"step {step}, {minutes:.1f} min: loss {np.mean(losses[-250:]):.4f}; held out: loss "
                f"{float(loss_of(found, mask)):.4f}, IoU {iou(found.sigmoid(), mask):.4f} for {iou(before, mask):.4f}",
                flush=True,
            )
            config = {"steps": step, "examples": len(examples.frame), "minutes": round(minutes, 1)}
            save_outline_network(averaged, arguments.out, config)


if __name__ == "__main__":
    main()
