"""Train the network for shapes on squares that `training.segmentation.shape_examples` made.

    python -m training.segmentation.train_shapes EXAMPLES OUT --minutes 20 [--threads 1]

The mask that the network is shown is the exact one, or one as a network might find it. The learning rate falls to
nothing over --minutes. The scenes of the last HELD share are held out; on them the number of frames is fitted whose
answers are worth as much as independent ones. OUT gets the weights in the shipped form.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
import torch.nn.functional as F
from scipy.optimize import minimize_scalar
from torch import Tensor

from pipeline.bodies.networks.body_shapes import input_of
from pipeline.bodies.networks.shape_network import ShapeNetwork, save_shape_network
from pipeline.scene.scene import BASIC_SHAPES
from training.segmentation.shape_examples import ShapeExamples, load_examples
from training.segmentation.timed_training import read_arguments, train_for
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
    arguments = read_arguments(__doc__, minutes=20)
    generator, rng = torch.Generator().manual_seed(arguments.seed), np.random.default_rng(arguments.seed)
    examples = load_examples(arguments.examples)
    border = np.quantile(examples.body[:, 0], 1 - HELD)
    held, used = np.flatnonzero(examples.body[:, 0] > border), np.flatnonzero(examples.body[:, 0] <= border)
    print(f"{len(used)} examples", flush=True)
    network, averaged = ShapeNetwork(), ShapeNetwork()

    def draw() -> tuple[Tensor, Tensor]:
        return batch_of(examples, np.sort(rng.choice(used, BATCH, replace=False)), generator, augment=True)

    def report(step: int, minutes: float, loss: float) -> None:
        mean, true = answers(averaged, examples, held)
        independent = float(minimize_scalar(loss_with, (0.2, 1.0), args=(mean, true)).x)
        right = float((mean.argmax(1) == true).mean())
        print(
            f"step {step}, {minutes:.1f} min: loss {loss:.4f}; held out, {len(true)} bodies: "
            f"right {right:.4f}, loss {loss_with(independent, mean, true):.4f} at {independent:.2f} frames",
            flush=True,
        )
        config = {"steps": step, "examples": len(used), "minutes": round(minutes, 1)}
        save_shape_network(averaged, arguments.out, config | {"independent_frames": round(independent, 2)})

    loss_of = partial(F.cross_entropy, label_smoothing=SMOOTHING)
    train_for(arguments, network, averaged, rate=RATE, decay=DECAY, draw=draw, loss_of=loss_of, report=report)


if __name__ == "__main__":
    main()
