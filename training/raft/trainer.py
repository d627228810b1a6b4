"""The training of RAFT-small: losses, optimisers, schedule, checkpoints."""

from __future__ import annotations

import argparse
import math
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pipeline.csv_rows import append_row
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import RAFT, sequence_loss
from training.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from training.muon import Muon
from training.raft.flow_scores import held_out, score
from training.raft.matching_loss import matching_loss
from training.raft.pair_stream import RENDER_SIZE, Batch, PairStream, Phase, phase_at

HELD_OUT_SEED = 20_261_121  # of the pairs in the log; the training uses other seeds
HELD_OUT_PAIRS = 60
HELD_OUT_ITERATIONS = 4
OUTSIDE_PX = 2.0  # pixels that move further out of the window than this carry no loss
WARM_UP = 0.04  # share of the training
MIN_MATRIX = 8  # rows and columns from which on Muon has a weight
CLIP = 1.0


@dataclass
class Progress:
    """Seconds, steps and pairs of a training so far, resumed runs included."""

    seconds: float = 0.0
    steps: int = 0
    pairs: int = 0


def one_cycle(progress: float) -> float:
    """Factor of the learning rate at a share of the training: a linear rise, then half a cosine down."""
    if progress < WARM_UP:
        return 0.02 + 0.98 * progress / WARM_UP
    return 0.5 * (1 + math.cos(math.pi * min(1.0, (progress - WARM_UP) / (1 - WARM_UP)))) + 1e-3


def train_step(
    model: RAFT,
    optimisers: list[torch.optim.Optimizer],
    batch: Batch,
    iterations: int,
    foreground_weight: float,
    matching_weight: float,
) -> tuple[float, float]:
    """One step of all optimisers on a batch.

    Args:
        model: Is changed.
        optimisers: Of its parameters.
        batch: Of pairs.
        iterations: Recurrent updates.
        foreground_weight: Extra weight of foreground pixels in the flow's loss.
        matching_weight: Of the matching loss.

    Returns:
        The loss of the flow, px, and of the matching, nats.
    """
    device = next(model.parameters()).device
    a, b = (torch.from_numpy(f).to(device).permute(0, 3, 1, 2).float() for f in (batch.frames_a, batch.frames_b))
    truth = torch.from_numpy(batch.flow_px).to(device).permute(0, 3, 1, 2)
    foreground = torch.from_numpy(batch.foreground).to(device)
    weight = (1 + foreground_weight * foreground.float()) * stays_inside(truth)
    weight = weight / weight.sum((1, 2), keepdim=True).clamp(min=1)  # every pair has the same weight
    correlation = model.correlate(a, b)
    start = None if batch.start_px is None else torch.from_numpy(batch.start_px).to(device).permute(0, 3, 1, 2)
    flows = model(a, b, iterations, draft=True, correlation=correlation, start=start)
    loss = sequence_loss(flows, truth, weight)
    matching = matching_loss(correlation, truth, foreground)
    model.zero_grad(set_to_none=True)
    (loss + matching_weight * matching).backward()
    norm = torch.nn.utils.clip_grad_norm_(model.parameters(), CLIP)
    if torch.isfinite(norm):
        for optimiser in optimisers:
            optimiser.step()
    return float(loss.detach()), float(matching.detach())


def stays_inside(flow: torch.Tensor) -> torch.Tensor:
    """(B, H, W) bool: pixels whose flow (B, 2, H, W), px, ends at most OUTSIDE_PX outside of the picture."""
    _, _, h, w = flow.shape
    y, x = torch.meshgrid(torch.arange(h, device=flow.device), torch.arange(w, device=flow.device), indexing="ij")
    tx, ty = x + flow[:, 0], y + flow[:, 1]
    return (tx > -OUTSIDE_PX) & (tx < w - 1 + OUTSIDE_PX) & (ty > -OUTSIDE_PX) & (ty < h - 1 + OUTSIDE_PX)


def make_optimisers(model: RAFT, rate: float, muon_rate: float) -> list[torch.optim.Optimizer]:
    """Muon for the convolutions between hidden features, AdamW for the rest."""
    hidden = [p for p in model.parameters() if p.ndim == 4 and min(p.flatten(1).shape) >= MIN_MATRIX]
    chosen = {id(p) for p in hidden}
    rest = [p for p in model.parameters() if id(p) not in chosen]
    return [Muon(hidden, muon_rate), torch.optim.AdamW(rest, rate, weight_decay=0.0)]


def save_training(path: Path, model: RAFT, optimisers: list[torch.optim.Optimizer], progress: Progress) -> None:
    """Write the checkpoint of a training."""
    state = {
        "model": model.state_dict(),
        "optimisers": [o.state_dict() for o in optimisers],
        "progress": vars(progress),
    }
    save_checkpoint(path, state)


def train(arguments: argparse.Namespace) -> tuple[RAFT, Progress]:
    """Train until `--minutes` are over; the arguments are those of `python -m training.raft`."""
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments).to(arguments.device)
    optimisers = make_optimisers(model, arguments.rate, arguments.muon_rate)
    progress = Progress()
    checkpoint = out / "checkpoint.safetensors"
    if has_checkpoint(checkpoint) and arguments.resume:
        state = load_checkpoint(checkpoint, arguments.device)
        model.load_state_dict(state["model"])
        for optimiser, values in zip(optimisers, state.get("optimisers", []), strict=False):
            optimiser.load_state_dict(values)
        progress = Progress(**state["progress"])
        print(f"resumed at {progress.seconds / 60:.1f} min, step {progress.steps}", flush=True)
    total = arguments.minutes * 60
    phases = (
        Phase(0.0, (96, 64), arguments.batch, arguments.iterations, warped=arguments.warped),
        Phase(0.25, (96, 64), arguments.batch, arguments.iterations, warped=0.35),
        Phase(0.75, (128, 96), arguments.batch, arguments.iterations, warped=0.2),
        Phase(0.95, RENDER_SIZE, max(2, arguments.batch // 3), arguments.iterations),
    )
    stream = PairStream(
        arguments.seed,
        progress.steps,
        phases,
        workers=arguments.workers,
        mujoco_share=arguments.mujoco_share,
        warm_start=model.warm_start,
    )
    stream.advance(progress.seconds / total)
    validation = held_out(HELD_OUT_SEED, HELD_OUT_PAIRS)
    dis = score(DIS("medium"), validation, HELD_OUT_ITERATIONS)
    print(f"held-out pairs, DIS medium: foreground {dis.foreground:.3f} px, all {dis.frame:.3f} px", flush=True)
    stopped = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopped.set())  # save, then stop
    losses: list[tuple[float, float]] = []
    last = saved = validated = time.monotonic()
    model.train()
    for batch in stream:
        share = progress.seconds / total
        for optimiser, rate in zip(optimisers, (arguments.muon_rate, arguments.rate), strict=True):
            for group in optimiser.param_groups:
                group["lr"] = rate * one_cycle(share)
        # The weight of the matching loss falls with the learning rate: at the end only the flow counts.
        weights = (arguments.foreground_weight, arguments.matching_weight * one_cycle(share))
        iterations = phase_at(phases, share).iterations
        losses.append(train_step(model, optimisers, batch, iterations, *weights))
        now = time.monotonic()
        progress.seconds += now - last
        last = now
        progress.steps += 1
        progress.pairs += len(batch.frames_a)
        stream.advance(progress.seconds / total)
        done = progress.seconds >= total or stopped.is_set()
        if progress.steps % 250 == 0:
            recent = np.mean(losses[-250:], axis=0)
            print(
                f"{progress.seconds / 60:.1f} min, step {progress.steps}: loss {recent[0]:.3f}, {recent[1]:.3f}",
                flush=True,
            )
        if done or now - saved > arguments.save_minutes * 60:
            save_training(checkpoint, model, optimisers, progress)
            saved = now
        if not stopped.is_set() and (done or now - validated > arguments.validate_minutes * 60):
            raft = score(model, validation, HELD_OUT_ITERATIONS)
            model.train()
            row: dict[str, float | str] = {
                "minutes": round(progress.seconds / 60, 2),
                "step": progress.steps,
                "pairs": progress.pairs,
                "rate": f"{optimisers[-1].param_groups[0]['lr']:.2e}",
                "loss": round(float(np.mean(losses, axis=0)[0]), 4),
                "matching": round(float(np.mean(losses, axis=0)[1]), 4),
                "raft_foreground_epe": round(raft.foreground, 4),
                "dis_foreground_epe": round(dis.foreground, 4),
                "raft_epe": round(raft.frame, 4),
                "dis_epe": round(dis.frame, 4),
            }
            append_row(out / "log.csv", row)
            print(" ".join(f"{k} {v}" for k, v in row.items()), flush=True)
            losses.clear()
            validated = last = time.monotonic()
        if done:
            break
    stream.close()
    if stopped.is_set():
        print(
            f"stopped and saved at {progress.seconds / 60:.1f} min; the same command continues from there", flush=True
        )
        raise SystemExit(1)
    return model, progress


def new_model(arguments: argparse.Namespace) -> RAFT:
    """RAFT-small with random weights, with the warm start that the arguments name."""
    return RAFT(
        "small", convex_upsampling=True, warm_start=None if arguments.warm_start == "none" else arguments.warm_start
    )


def read_checkpoint(path: Path, arguments: argparse.Namespace) -> tuple[RAFT, Progress]:
    """The model of a checkpoint, for use, and how far its training was."""
    state = load_checkpoint(path)
    model = new_model(arguments)
    model.load_state_dict(state["model"])
    return model, Progress(**state["progress"])
