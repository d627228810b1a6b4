"""Train the network for shapes on squares that `training.segmentation.shape_examples` made.

    python -m training.segmentation.train_shapes EXAMPLES OUT --minutes 20 [--threads 1]

The mask that the network is shown is the exact one, or one as a network might find it. The learning rate falls to
nothing over --minutes. The scenes of the last HELD share are held out; on them the number of frames is fitted whose
answers are worth as much as independent ones. OUT gets the weights in the shipped form.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from scipy.optimize import minimize_scalar
from torch import Tensor

from pipeline.scene.scene import BASIC_SHAPES
from pipeline.segmentation.body_shapes import input_of
from pipeline.segmentation.shape_network import ShapeNetwork, save_shape_network
from training.segmentation.shape_examples import ShapeExamples, load_examples
from training.segmentation.train import average_weights, learning_rate
from training.segmentation.train_outlines import degraded

BATCH, RATE, DECAY = 64, 2e-3, 1e-2
HELD = 0.06  # of the scenes
SMOOTHING = 0.02
EXACT = 0.4  # share of the masks that are exact


def batch_of(
    examples: ShapeExamples, chosen: np.ndarray, generator: torch.Generator, augment: bool
) -> tuple[Tensor, Tensor]:
    """Input (B, INPUTS, SIDE, SIDE) and shapes (B,) of some examples."""
    frame = torch.from_numpy(examples.frame[chosen]).permute(0, 3, 1, 2).float() / 255
    mask, others = (torch.from_numpy(m[chosen]).float() / 255 for m in (examples.mask, examples.others))
    if augment:
        gain = torch.exp(0.15 * torch.randn(len(chosen), 3, 1, 1, generator=generator))
        frame = (frame * gain)[:, torch.randperm(3, generator=generator)].clamp(0, 1)
        if torch.rand(1, generator=generator) < 0.5:
            frame, mask, others = (x.flip(-1) for x in (frame, mask, others))
    exact = torch.rand(len(chosen), 1, 1, generator=generator) < EXACT
    shown = torch.where(exact, mask, degraded(mask, generator))
    return input_of(frame, torch.stack([shown, others], 1)), torch.from_numpy(examples.shape[chosen]).long()


def answers(network: ShapeNetwork, examples: ShapeExamples, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each body of some examples the mean of its frames' log probabilities (N, 3), and its shape (N,)."""
    generator = torch.Generator().manual_seed(1)
    logs = []
    with torch.inference_mode():
        for part in np.array_split(chosen, max(len(chosen) // BATCH, 1)):
            logs.append(network(batch_of(examples, part, generator, augment=False)[0]).log_softmax(1).numpy())
    _, first, body = np.unique(examples.body[chosen], axis=0, return_index=True, return_inverse=True)
    mean = np.zeros((len(first), len(BASIC_SHAPES)))
    np.add.at(mean, body, np.concatenate(logs))
    return mean / np.bincount(body)[:, None], examples.shape[chosen][first]


def loss_with(independent: float, mean: np.ndarray, shape: np.ndarray) -> float:
    """Mean loss (nats) of bodies' shapes (N,), if so many of their frames are independent; mean as of `answers`."""
    logs = torch.from_numpy(mean * independent).log_softmax(1).numpy()
    return float(-logs[np.arange(len(shape)), shape].mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--bfloat16", action="store_true", help="twice as fast where the processor has AMX")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    generator = torch.Generator().manual_seed(arguments.seed)
    examples = load_examples(arguments.examples)
    border = np.quantile(examples.body[:, 0], 1 - HELD)
    held, used = np.flatnonzero(examples.body[:, 0] > border), np.flatnonzero(examples.body[:, 0] <= border)
    network = ShapeNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    averaged = ShapeNetwork().eval()
    averaged.load_state_dict(network.state_dict())
    print(f"{len(used)} examples, {sum(p.numel() for p in network.parameters())} parameters", flush=True)
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=DECAY)
    rng, start, step, losses = np.random.default_rng(arguments.seed), time.monotonic(), 0, []
    while (share := (time.monotonic() - start) / (60 * arguments.minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = RATE * learning_rate(step, share)
        squares, shape = batch_of(examples, np.sort(rng.choice(used, BATCH, replace=False)), generator, augment=True)
        with torch.autocast("cpu", torch.bfloat16, enabled=arguments.bfloat16):
            logits = network.train()(squares.contiguous(memory_format=torch.channels_last))
        loss = F.cross_entropy(logits.float(), shape, label_smoothing=SMOOTHING)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        step += 1
        average_weights(averaged.state_dict(), network, step)
        losses.append(loss.item())
        if step % 250 == 0 or time.monotonic() - start >= 60 * arguments.minutes:
            minutes = (time.monotonic() - start) / 60
            mean, true = answers(averaged, examples, held)
            independent = float(minimize_scalar(loss_with, (0.2, 1.0), args=(mean, true)).x)
            right = float((mean.argmax(1) == true).mean())
            print(
                f"step {step}, {minutes:.1f} min: loss {np.mean(losses[-250:]):.4f}; held out, {len(true)} bodies: "
                f"right {right:.4f}, loss {loss_with(independent, mean, true):.4f} at {independent:.2f} frames",
                flush=True,
            )
            config = {"steps": step, "examples": len(used), "minutes": round(minutes, 1)}
            save_shape_network(averaged, arguments.out, config | {"independent_frames": round(independent, 2)})


if __name__ == "__main__":
    main()
