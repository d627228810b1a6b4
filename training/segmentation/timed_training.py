"""The training of a small network on squares for a given time, with a moving average of its weights."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from training.segmentation.train import average_weights, learning_rate

EVERY = 250  # steps between two reports


def read_arguments(description: str | None, minutes: float) -> argparse.Namespace:
    """The arguments of such a training; sets threads and seed. minutes: the default."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=minutes)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--bfloat16", action="store_true", help="twice as fast where the processor has AMX")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    return arguments


def train_for(
    arguments: argparse.Namespace,
    network: nn.Module,
    averaged: nn.Module,
    *,
    rate: float,
    decay: float,
    draw: Callable[[], tuple[Tensor, Tensor]],
    loss_of: Callable[[Tensor, Tensor], Tensor],
    report: Callable[[int, float, float], None],
) -> None:
    """Train a network; the learning rate falls to nothing over the time.

    Args:
        arguments: Of `read_arguments`.
        network: To be trained.
        averaged: Another one of its kind, which gets the moving average of the weights.
        rate: Highest learning rate.
        decay: Of the weights.
        draw: Makes a batch: squares (B, C, S, S) and what is to be answered.
        loss_of: Of answers, and what was to be answered.
        report: Called every EVERY steps and at the end with the step, the minutes and the mean loss since.
    """
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    averaged.eval().load_state_dict(network.state_dict())
    print(f"{sum(p.numel() for p in network.parameters())} parameters", flush=True)
    optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=decay)
    start, step, losses = time.monotonic(), 0, []
    while (share := (time.monotonic() - start) / (60 * arguments.minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = rate * learning_rate(step, share)
        squares, answer = draw()
        with torch.autocast("cpu", torch.bfloat16, enabled=arguments.bfloat16):
            found = network.train()(squares.contiguous(memory_format=torch.channels_last))
        loss = loss_of(found.float(), answer)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        step += 1
        average_weights(averaged.state_dict(), network, step)
        losses.append(loss.item())
        if step % EVERY == 0 or time.monotonic() - start >= 60 * arguments.minutes:
            report(step, (time.monotonic() - start) / 60, float(np.mean(losses[-EVERY:])))
