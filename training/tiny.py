"""Train the tiny model on clips made on the way: sample, simulate, exact flow with noise, events, tokens.

    python -m training.tiny --minutes 90 --out models/tiny

Generator processes stream clips into a pool from which batches are drawn; a clip is drawn a few times before a
newer one takes its place. Stops at --minutes; the learning rate falls to nothing in the last --decay of them. Writes a
checkpoint every few minutes and goes on from the last one; `before_decay.pt` is the one to train longer from (copy it
to `checkpoint.pt` and give more --minutes); without it, --start goes on from a finished model. `log.csv` in --work has
the losses. The vision tower learns what the simulator knows of each patch (training/patch_labels.py): alone in the
first --vision minutes, then beside the completion, of clips with one, two and three objects first; the noise of the
flow rises from nothing to RAFT's in the first --quiet minutes.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import time
from pathlib import Path

import numpy as np
import torch
from torch import multiprocessing

from pipeline.evaluation.csv_rows import read_rows
from pipeline.language.completion import MAX_OBJECTS
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.example_pool import Pool
from training.examples import CHUNK, SUITE, Example, Kind, generate, make_examples
from training.measured import Measured
from training.tiny_trainer import Progress, Trainer, read_checkpoint

CHECKPOINT = "checkpoint.pt"  # in --work
LOG = "log.csv"  # in --work, and beside the weights
HEAD_STEPS = 200  # of batches, for the head on patch labels, which is not saved with a model


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


def progress_of(row: dict[str, str], batch: int) -> Progress:
    """How far a training had got by a row of its log."""
    return Progress(step=int(row["clips"]) // batch, seconds=60 * float(row["minutes"]),
                    chunk=int(row["fresh_clips"]) // CHUNK)  # fmt: skip


def append_row(path: Path, row: dict[str, float]) -> None:
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, row)
        if file.tell() == 0:
            writer.writeheader()
        writer.writerow(row)


def train(args: argparse.Namespace) -> None:
    params, kind = read_params_file(PARAMS_FILE, Params), Kind(args.input, args.silent)
    checkpoint = args.work / CHECKPOINT
    torch.set_num_threads(args.threads)
    torch.set_float32_matmul_precision(args.matmul)
    args.work.mkdir(parents=True, exist_ok=True)
    trainer = Trainer(args.device, args.lr, args.muon_lr, args.patch_weight)
    starts = bool(args.start) and not checkpoint.is_file()
    if checkpoint.is_file():
        trainer.load(checkpoint)
        print(f"goes on from step {trainer.progress.step}, {trainer.progress.seconds / 60:.1f} min", flush=True)
    elif starts:
        shutil.copy(args.start / LOG, args.work / LOG)
        trainer.progress = progress_of(read_rows(args.work / LOG)[-1], args.batch)
    progress = trainer.progress
    warm_up_from = progress.step if starts else progress.seen
    minutes = progress.seconds / 60

    context = multiprocessing.get_context("spawn")
    source = context.Queue(maxsize=2 * args.generators + 2)
    noise = context.Value("d", noise_at(minutes, args.quiet))
    most = context.Value("i", most_objects(minutes, args.vision, args.few))
    makers = [context.Process(target=generate, daemon=True,
                              args=(params, kind, progress.chunk + i, args.generators, source, noise, most))
              for i in range(args.generators)]  # fmt: skip
    for maker in makers:
        maker.start()
    measured = Measured(args.measured) if args.measured else None
    pool = Pool(args.pool, args.reuse, source, [], share=args.measured_share if measured else 0.0)
    held: list[Example]
    if measured:
        held = measured.refresh()[: args.validation]
    else:
        held = make_examples(params, trainer.base.codec, kind, SUITE + "-held", range(args.validation), kind.silent < 1)

    rng = np.random.default_rng(progress.step)
    if starts:
        pool.fill(least=8 * args.batch)
        trainer.start_from(args.start, (pool.mosaics(rng, args.batch) for _ in range(HEAD_STEPS)))
    began, last_save, last_log = time.monotonic() - progress.seconds, time.monotonic(), -np.inf
    recent: list[tuple[float, float]] = []

    def log(share: float) -> None:
        losses = dict(zip(("train_loss", "patch_loss"), np.mean(recent or [(np.nan,) * 2], 0).tolist(), strict=True))
        row = {"step": progress.step, "clips": progress.step * args.batch, "fresh_clips": progress.chunk * CHUNK,
               "minutes": round(progress.seconds / 60, 2), "rate": round(share, 4), **losses}  # fmt: skip
        row |= trainer.validate(held, args.batch)
        print({k: round(v, 6) for k, v in row.items()}, flush=True)
        append_row(args.work / LOG, row)

    while (elapsed := time.monotonic() - began) < 60 * args.minutes:
        before, minutes = minutes, elapsed / 60
        if before < args.minutes - args.decay <= minutes:
            trainer.save(args.work / "before_decay.pt")
        if measured and elapsed - last_log > args.log_seconds:
            pool.kept = measured.refresh()[args.validation :]
        noise.value = noise_at(minutes, args.quiet)
        pool.most = most.value = most_objects(minutes, args.vision, args.few)
        pool.fill(least=8 * args.batch)
        alone = minutes < args.vision
        step = progress.step if alone else progress.step - warm_up_from
        share = learning_rate(step, args.minutes - minutes, args.decay)
        if alone:
            recent.append(trainer.learn_to_see(*pool.mosaics(rng, args.batch), share))
        else:
            recent.append(trainer.learn(pool.draw(rng, args.batch), share))
        progress.seconds, progress.chunk = elapsed, max(progress.chunk, pool.last_chunk + 1)
        if elapsed - last_log > args.log_seconds:
            last_log = elapsed
            log(share)
            recent.clear()
        if time.monotonic() - last_save > args.save_seconds:
            last_save = time.monotonic()
            trainer.save(checkpoint)
    log(0.0)
    trainer.save(checkpoint)
    trainer.base.input = kind.model_input(params)
    trainer.base.save(args.out)
    shutil.copy(args.work / LOG, args.out / LOG)
    print(f"saved to {args.out}", flush=True)
    for maker in makers:
        maker.terminate()


def export(work: Path, out: Path, kind: Kind) -> None:
    """Write the model of the last checkpoint as it stands, and the log."""
    base, _ = read_checkpoint(work / CHECKPOINT)
    base.input = kind.model_input(read_params_file(PARAMS_FILE, Params))
    base.save(out)
    shutil.copy(work / LOG, out / LOG)
    print(f"saved to {out}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=90, help="whole training time, earlier runs counted in")
    parser.add_argument("--out", type=Path, default=Path("models/tiny"), help="where the model is written at the end")
    parser.add_argument(
        "--start", type=Path, help="folder of a trained model to go on from, where --work has no checkpoint"
    )
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
        export(args.work, args.out, Kind(args.input, args.silent))
    else:
        train(args)


if __name__ == "__main__":
    main()
