"""Trains RAFT-small, with learned upsampling, from scratch on rendered pairs with exact flow.

    python -m training.raft --minutes 100                          # one CPU core and one generator process
    python -m training.raft --minutes 60 --device cuda --batch 64 --workers 14
    python -m training.raft --export models/raft-small             # write the last checkpoint, train nothing

It reads nothing: pairs are made on the fly (`training/flow_pairs.py`). Into --out go `checkpoint.pt` (every few
minutes, replaced at once; a run that finds one goes on from it) and `log.csv` (error on held-out pairs beside
OpenCV DIS's). At the end, or by --export, it writes `model.safetensors`, `config.json` and a model card.
The learning rate follows the clock: a one-cycle over --minutes of training, resumed runs included.
"""

from __future__ import annotations

import argparse
import csv
import math
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pipeline.vision.flow.dis import DIS, PRESETS
from pipeline.vision.flow.raft import RAFT, sequence_loss
from training.flow_scores import held_out, score
from training.matching_loss import matching_loss
from training.muon import Muon
from training.pair_stream import RENDER_SIZE, Batch, PairStream, Phase, phase_at
from training.raft_card import write_card

HELD_OUT_SEED = 20_261_121  # of the pairs that the log is about; training uses others
HELD_OUT_PAIRS = 60
HELD_OUT_ITERATIONS = 4
OUTSIDE_PX = 2.0  # what moves further out of the window than this teaches nothing
WARM_UP = 0.04  # share of the training
SMALLEST_MATRIX = 8  # a weight with fewer rows or columns has no directions to make alike
CLIP = 1.0


@dataclass
class Progress:
    """How far a training has come: seconds of training, steps and pairs, over all its runs."""

    seconds: float = 0.0
    steps: int = 0
    pairs: int = 0


def one_cycle(progress: float) -> float:
    """Factor of the learning rate at a share of the training: linear up, then half a cosine down."""
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
    """One step on a batch; the losses of the flow, px, and of the matching, nats."""
    device = next(model.parameters()).device
    a, b = (torch.from_numpy(f).to(device).permute(0, 3, 1, 2).float() for f in (batch.frames_a, batch.frames_b))
    truth = torch.from_numpy(batch.flow_px).to(device).permute(0, 3, 1, 2)
    foreground = torch.from_numpy(batch.foreground).to(device)
    weight = (1 + foreground_weight * foreground.float()) * stays_inside(truth)
    weight = weight / weight.sum((1, 2), keepdim=True).clamp(min=1)  # every pair counts alike
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
    """(B, H, W) bool: pixels whose flow (B, 2, H, W), px, does not lead out of the picture by more than a little."""
    _, _, h, w = flow.shape
    y, x = torch.meshgrid(torch.arange(h, device=flow.device), torch.arange(w, device=flow.device), indexing="ij")
    tx, ty = x + flow[:, 0], y + flow[:, 1]
    return (tx > -OUTSIDE_PX) & (tx < w - 1 + OUTSIDE_PX) & (ty > -OUTSIDE_PX) & (ty < h - 1 + OUTSIDE_PX)


def make_optimisers(model: RAFT, rate: float, muon_rate: float) -> list[torch.optim.Optimizer]:
    """Muon for the convolutions between hidden features, AdamW for the rest."""
    hidden = [p for p in model.parameters() if p.ndim == 4 and min(p.flatten(1).shape) >= SMALLEST_MATRIX]
    chosen = {id(p) for p in hidden}
    rest = [p for p in model.parameters() if id(p) not in chosen]
    return [Muon(hidden, muon_rate), torch.optim.AdamW(rest, rate, weight_decay=0.0)]


def save_checkpoint(path: Path, model: RAFT, optimisers: list[torch.optim.Optimizer], progress: Progress) -> None:
    state = {
        "model": model.state_dict(),
        "optimisers": [o.state_dict() for o in optimisers],
        "progress": vars(progress),
    }
    temporary = path.with_suffix(".part")
    torch.save(state, temporary)
    temporary.replace(path)


def append_row(path: Path, row: dict[str, float | str]) -> None:
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(row))
        if new:
            writer.writeheader()
        writer.writerow(row)


def train(arguments: argparse.Namespace) -> tuple[RAFT, Progress]:
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(arguments.seed)
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    model = new_model(arguments).to(arguments.device)
    optimisers = make_optimisers(model, arguments.rate, arguments.muon_rate)
    progress = Progress()
    checkpoint = out / "checkpoint.pt"
    if checkpoint.exists() and arguments.resume:
        state = torch.load(checkpoint, map_location=arguments.device, weights_only=True)
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
        arguments.seed, progress.steps, phases, arguments.workers, arguments.mujoco_share, model.warm_start
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
        # The lesson of the features fades out with the rate: at the end the flow alone counts.
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
            save_checkpoint(checkpoint, model, optimisers, progress)
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
        print(f"stopped and saved at {progress.seconds / 60:.1f} min; the same command goes on from there", flush=True)
        raise SystemExit(1)
    return model, progress


def new_model(arguments: argparse.Namespace) -> RAFT:
    return RAFT(
        "small", convex_upsampling=True, warm_start=None if arguments.warm_start == "none" else arguments.warm_start
    )


def export(model: RAFT, folder: Path, progress: Progress) -> None:
    """Write the weights and the model card with the errors measured now."""
    model.eval().to("cpu")
    model.save(folder)
    write_card(folder, model, progress.steps, progress.pairs)
    print(f"wrote {folder}", flush=True)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=100, help="of training in all; the learning rate's clock")
    parser.add_argument("--out", type=Path, default=Path(".train/raft"), help="checkpoints and log")
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--threads", type=int, default=1, help="of torch on the CPU")
    parser.add_argument("--workers", type=int, default=1, help="processes that make pairs")
    parser.add_argument("--batch", type=int, default=8, help="pairs a step (a third in the last phase)")
    parser.add_argument("--iterations", type=int, default=3, help="of the recurrence in training (one less at first)")
    parser.add_argument("--rate", type=float, default=5e-4, help="highest learning rate of AdamW")
    parser.add_argument("--muon-rate", type=float, default=2e-3, help="highest learning rate of Muon")
    parser.add_argument("--warm-start", choices=("none", *PRESETS), default="none", help="DIS's flow to begin from")
    parser.add_argument("--foreground-weight", type=float, default=4.0, help="extra weight of moving bodies' pixels")
    parser.add_argument("--matching-weight", type=float, default=1.0, help="of the features' own loss, at the start")
    parser.add_argument("--warped", type=float, default=1.0, help="share of warped textures in the first quarter")
    parser.add_argument(
        "--mujoco-share",
        type=float,
        default=0.03,
        help="of pairs that MuJoCo renders where it can (30 times slower; the pictures are alike)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--save-minutes", type=float, default=3)
    parser.add_argument("--validate-minutes", type=float, default=8)
    parser.add_argument("--resume", action=argparse.BooleanOptionalAction, default=True, help="go on from --out")
    parser.add_argument("--weights", type=Path, default=Path("models/raft-small"), help="where the end is written")
    parser.add_argument("--export", type=Path, help="write the last checkpoint to this folder and stop")
    return parser.parse_args()


def main() -> None:
    arguments = parse()
    if arguments.export is None:
        model, progress = train(arguments)
    else:
        torch.set_num_threads(arguments.threads)
        model = new_model(arguments)
        state = torch.load(arguments.out / "checkpoint.pt", map_location="cpu", weights_only=True)
        model.load_state_dict(state["model"])
        progress = Progress(**state["progress"])
    export(model, arguments.export or arguments.weights, progress)


if __name__ == "__main__":
    main()
