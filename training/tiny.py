"""Train the tiny model on clips made on the way: sample, simulate, exact flow with noise, events, tokens.

    python -m training.tiny --minutes 90 --out models/tiny

Generator processes stream clips into a pool from which batches are drawn; a clip is drawn a few times before a
newer one takes its place. Stops at --minutes; the learning rate falls to nothing in the last --decay of them. Writes a
checkpoint every few minutes and goes on from the last one; `before_decay.pt` is the one to train longer from (copy it
to `checkpoint.pt` and give more --minutes). `log.csv` in --work has the losses. The vision tower learns what the
simulator knows of each patch (training/patch_labels.py): alone in the first --vision minutes, then beside the
completion, of clips with one, two and three objects first; the noise of the flow rises from nothing to RAFT's in the
first --quiet minutes.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import multiprocessing

from pipeline.language.codec import Codec
from pipeline.language.completion import MAX_OBJECTS
from pipeline.language.tokenizer import build_tokenizer
from pipeline.model.base import Base
from pipeline.model.inputs import video_inputs
from pipeline.model.loss import batch_loss, make_batch
from pipeline.model.tiny import TinySize, build_tiny
from pipeline.scene.scene import BASIC_SHAPES
from stages.params import PARAMS_FILE, Params
from stages.params_file import read_params_file
from training.example_pool import Pool
from training.examples import CHUNK, LAYOUT, SUITE, Example, Kind, generate, make_examples
from training.measured import Measured
from training.muon import Muon
from training.patch_labels import PatchHead


def new_base() -> Base:
    """The tiny model with random weights, always the same."""
    tokenizer = build_tokenizer()
    return Base(build_tiny(tokenizer, TinySize(), seed=0), tokenizer, LAYOUT, Codec(tokenizer, LAYOUT.tokens))


@torch.no_grad()
def validate(base: Base, examples: list[Example], batch_size: int) -> dict[str, float]:
    """Mean loss of free tokens, and of the shapes and numbers among them, nats."""
    base.model.eval()
    shape_ids = [base.tokenizer.convert_tokens_to_ids(s) for s in BASIC_SHAPES]
    sums = {"loss": [0.0, 0], "shape_loss": [0.0, 0], "number_loss": [0.0, 0]}
    for start in range(0, len(examples), batch_size):
        chosen = examples[start : start + batch_size]
        batch = make_batch(base, [e.tokens for e in chosen], np.stack([e.picture for e in chosen]))
        each = batch_loss(base, batch)[1].float().cpu()
        prompt = len(base.codec.prompt_ids)
        labels = batch.labels[:, prompt:]
        numeric = torch.zeros_like(labels, dtype=torch.bool)
        for i, e in enumerate(chosen):
            numeric[i, : len(e.tokens.ids) - prompt] = torch.as_tensor(e.tokens.numeric[prompt:])
        shapes = torch.isin(labels, torch.tensor(shape_ids))
        for key, which in (("loss", labels != -100), ("shape_loss", shapes), ("number_loss", numeric)):
            sums[key][0] += float(each[which].sum())
            sums[key][1] += int(which.sum())
    base.model.train()
    return {key: total / max(count, 1) for key, (total, count) in sums.items()}


def learning_rate(step: int, left: float, decay: float) -> float:
    """A share of the peak: linear warm-up in 100 steps of a phase, then 1, and in a line down to 2 % once less than
    `decay` is `left` of the time."""
    return min(1.0, (step + 1) / 100) * (0.02 + 0.98 * min(1.0, left / decay) if decay else 1.0)


def noise_at(minutes: float, quiet: float) -> float:
    """Strength of the noise after so many minutes, of which the first `quiet` are with less than RAFT's."""
    return min(1.0, minutes / quiet) if quiet else 1.0


def most_objects(minutes: float, vision: float, few: float) -> int:
    """Of a clip: one in the first third of the `few` minutes after those of the vision tower alone, two in the second,
    three in the last; any number before, since patches do not mind, and after. With one object, whatever the text looks
    at in the pictures is what it is about."""
    started = minutes - vision
    return 1 + int(3 * started / few) if 0 <= started < few else MAX_OBJECTS


def see(base: Base, clips: torch.Tensor) -> torch.Tensor:
    """The vision tower's tokens (B * tokens, hidden) of clips (B, T, H, W, 3) uint8."""
    patches, grid = video_inputs(base, clips)
    return base.model.model.visual(patches, grid_thw=grid).pooler_output


@torch.no_grad()
def shapes_right(base: Base, head: PatchHead, examples: list[Example]) -> float:
    """Share of the patches on objects in which the vision tower sees the right shape."""
    tokens = see(base, torch.as_tensor(np.stack([e.picture for e in examples])))
    return head.shapes_right(tokens, [e.patches for e in examples])


def make_optimizers(base: Base, head: PatchHead, rate: float, muon_rate: float) -> list[torch.optim.Optimizer]:
    """Muon for the matrices between hidden features, AdamW for the rest."""
    visual, language = base.model.model.visual, base.model.model.language_model
    inner = [*visual.blocks.parameters(), *visual.merger.parameters(), *language.layers.parameters()]
    hidden = [p for p in inner if p.ndim == 2]
    chosen = {id(p) for p in hidden}
    rest = [p for p in [*base.model.parameters(), *head.parameters()] if id(p) not in chosen]
    return [Muon(hidden, muon_rate, weight_decay=0.05),
            torch.optim.AdamW(rest, rate, betas=(0.9, 0.95), weight_decay=0.05)]  # fmt: skip


def save_checkpoint(
    path: Path, base: Base, head: PatchHead, optimizers: list[torch.optim.Optimizer], state: dict
) -> None:
    temporary = path.with_suffix(".tmp")
    weights = {"model": base.model.state_dict(), "head": head.state_dict(),
               "optimizers": [o.state_dict() for o in optimizers]}  # fmt: skip
    torch.save(weights | state, temporary)
    os.replace(temporary, path)


def train(args: argparse.Namespace) -> None:
    params = read_params_file(PARAMS_FILE, Params)
    torch.set_num_threads(args.threads)
    torch.set_float32_matmul_precision(args.matmul)
    base = new_base()
    model = base.model.to(args.device)
    if args.device == "cpu":
        model.set_attn_implementation("eager")  # faster than the fused kernel, whose products are many and small
    head = PatchHead(model.config.text_config.hidden_size, LAYOUT).to(args.device)
    seen: list[torch.Tensor] = []  # the vision tower's tokens in the last forward pass
    model.model.visual.register_forward_hook(lambda module, inputs, output: seen.append(output.pooler_output))
    weights = [*model.parameters(), *head.parameters()]
    optimizers = make_optimizers(base, head, args.lr, args.muon_lr)
    args.work.mkdir(parents=True, exist_ok=True)
    checkpoint = args.work / "checkpoint.pt"
    state: dict[str, Any] = {"step": 0, "seen": 0, "seconds": 0.0, "chunk": 0}  # seen: steps of the vision tower alone
    if checkpoint.is_file():
        stored = torch.load(checkpoint, map_location=args.device, weights_only=True)
        model.load_state_dict(stored.pop("model"))
        head.load_state_dict(stored.pop("head"))
        for optimizer, kept in zip(optimizers, stored.pop("optimizers"), strict=True):
            optimizer.load_state_dict(kept)
        state = stored
        print(f"goes on from step {state['step']}, {state['seconds'] / 60:.1f} min", flush=True)
    kind = Kind(args.input, args.silent)
    context = multiprocessing.get_context("spawn")
    source = context.Queue(maxsize=2 * args.generators + 2)
    noise = context.Value("d", noise_at(state["seconds"] / 60, args.quiet))
    most = context.Value("i", most_objects(state["seconds"] / 60, args.vision, args.few))
    makers = [context.Process(target=generate, daemon=True,
                              args=(params, kind, state["chunk"] + i, args.generators, source, noise, most))
              for i in range(args.generators)]  # fmt: skip
    for maker in makers:
        maker.start()
    pool = Pool(args.pool, args.reuse, source, [])
    measured = Measured(args.measured) if args.measured else None
    if measured is not None:
        held, pool.share = measured.refresh()[: args.validation], args.measured_share
    else:
        held = make_examples(params, base.codec, kind, SUITE + "-held", range(args.validation), args.silent < 1)
    rng = np.random.default_rng(state["step"])
    log = args.work / "log.csv"
    began, last_save, last_log, recent = time.monotonic() - state["seconds"], time.monotonic(), 0.0, []
    model.train()
    while (elapsed := time.monotonic() - began) < 60 * args.minutes:
        if measured is not None and (not pool.kept or elapsed - last_log > args.log_seconds):
            pool.kept = measured.refresh()[args.validation :]
        minutes, before = elapsed / 60, state["seconds"] / 60
        if before < args.minutes - args.decay <= minutes:
            save_checkpoint(args.work / "before_decay.pt", base, head, optimizers, state)
        pool.fill(least=8 * args.batch)
        noise.value = noise_at(minutes, args.quiet)
        pool.most = most.value = most_objects(minutes, args.vision, args.few)
        alone = minutes < args.vision
        step = state["step"] if alone else state["step"] - state["seen"]
        share = learning_rate(step, args.minutes - minutes, args.decay)
        for optimizer, peak in zip(optimizers, (args.muon_lr, args.lr), strict=True):
            for group in optimizer.param_groups:
                group["lr"] = share * peak
        with torch.autocast(args.device, torch.bfloat16, enabled=args.device == "cuda"):
            seen.clear()
            if alone:
                pictures, labels = pool.mosaics(rng, args.batch)
                tokens, loss = see(base, torch.as_tensor(pictures)), torch.zeros((), device=args.device)
            else:
                chosen = pool.draw(rng, args.batch)
                labels = [e.patches for e in chosen]
                batch = make_batch(base, [e.tokens for e in chosen], np.stack([e.picture for e in chosen]))
                loss, _ = batch_loss(base, batch)
                tokens = seen[-1]
            patch_loss = head(tokens, labels)
        for optimizer in optimizers:
            optimizer.zero_grad()
        (loss + args.patch_weight * patch_loss).backward()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        for optimizer in optimizers:
            optimizer.step()
        recent.append((loss.item(), patch_loss.item()))
        state["step"] += 1
        state["seen"] += alone
        state["seconds"], state["chunk"] = elapsed, max(state["chunk"], pool.last_chunk + 1)
        if elapsed - last_log > args.log_seconds:
            last_log = elapsed
            row = {"step": state["step"], "clips": state["step"] * args.batch, "fresh_clips": state["chunk"] * CHUNK,
                   "minutes": round(elapsed / 60, 2), "rate": round(share, 4),
                   **dict(zip(("train_loss", "patch_loss"), np.mean(recent, 0).tolist(), strict=True)),
                   **validate(base, held, args.batch), "shapes_right": shapes_right(base, head, held)}  # fmt: skip
            recent = []
            print({k: round(v, 6) for k, v in row.items()}, flush=True)
            with log.open("a", newline="") as file:
                writer = csv.DictWriter(file, row)
                if file.tell() == 0:
                    writer.writeheader()
                writer.writerow(row)
        if time.monotonic() - last_save > args.save_seconds:
            last_save = time.monotonic()
            save_checkpoint(checkpoint, base, head, optimizers, state)
    save_checkpoint(checkpoint, base, head, optimizers, state)
    base.save(args.out)
    print(f"saved to {args.out}", flush=True)
    for maker in makers:
        maker.terminate()


def export(checkpoint: Path, out: Path) -> None:
    """Write the model of a checkpoint as it stands."""
    base = new_base()
    base.model.load_state_dict(torch.load(checkpoint, map_location="cpu", weights_only=True)["model"])
    base.save(out)
    print(f"saved to {out}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=90, help="whole training time, earlier runs counted in")
    parser.add_argument("--out", type=Path, default=Path("models/tiny"), help="where the model is written at the end")
    parser.add_argument("--work", type=Path, default=Path(".train/tiny"), help="checkpoint and log")
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--matmul", default="medium", choices=("highest", "high", "medium"),
                        help="medium: products in bfloat16, where the processor has it")  # fmt: skip
    parser.add_argument("--generators", type=int, default=1, help="processes that make clips")
    parser.add_argument("--input", default="flow", choices=("flow", "rgb"), help="what the model is shown")
    parser.add_argument("--silent", type=float, default=0.25, help="share of the clips without reasoning")
    parser.add_argument(
        "--measured", type=Path, help="folder of examples by training.measured; the first --validation are held out"
    )
    parser.add_argument("--measured-share", type=float, default=0.5, help="of the clips drawn that are from there")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--lr", type=float, default=1.5e-3, help="peak, of AdamW")
    parser.add_argument("--muon-lr", type=float, default=4e-3, help="peak, of Muon, which has the hidden matrices")
    parser.add_argument("--patch-weight", type=float, default=0.5, help="of the loss on patch labels")
    parser.add_argument("--vision", type=float, default=30, help="minutes for the vision tower alone")
    parser.add_argument("--quiet", type=float, default=30, help="minutes until the flow is as noisy as RAFT's")
    parser.add_argument("--few", type=float, default=30, help="minutes after these with clips of few objects")
    parser.add_argument("--decay", type=float, default=20, help="minutes at the end in which the learning rate falls")
    parser.add_argument("--pool", type=int, default=4000, help="clips held in memory, 0.7 MB each")
    parser.add_argument("--reuse", type=float, default=4.0, help="draws per clip")
    parser.add_argument("--validation", type=int, default=64)
    parser.add_argument("--log-seconds", type=float, default=120)
    parser.add_argument("--save-seconds", type=float, default=180)
    parser.add_argument("--export", action="store_true", help="write the last checkpoint to --out and train nothing")
    args = parser.parse_args()
    if args.export:
        export(args.work / "checkpoint.pt", args.out)
    else:
        train(args)


if __name__ == "__main__":
    main()
