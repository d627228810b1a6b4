"""Train the tiny model on clips made during the training: sample, simulate, exact flow with noise, events, tokens.

    python -m training.tiny --minutes 90 --out models/tiny

Worker processes make clips; batches are drawn from a pool of the latest ones. The training ends after --minutes, and
the learning rate falls to zero in the last --decay of them. It writes a checkpoint to --work every few minutes, and a
run that finds one continues it. To train longer, copy `before_decay.safetensors` to `checkpoint.safetensors` and give
more --minutes; or continue a finished model with --start. `log.csv` in --work has the losses.

The vision tower also learns what the simulator knows of each patch (training/tiny/patch_labels.py): only that in the
first --vision-only minutes, then together with the text. The next --few-objects minutes have clips of one, two and
three objects. The noise of the flow rises from zero to RAFT's in the first --noise-ramp minutes.
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

import numpy as np
import torch
from torch import multiprocessing

from pipeline.csv_rows import append_row, read_rows
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.checkpoint import has_checkpoint
from training.tiny.example_pool import Pool
from training.tiny.examples import CHUNK, SUITE, Example, ExampleKind, generate, make_examples
from training.tiny.measured import MeasuredExamples
from training.tiny.schedule import learning_rate, max_objects, noise_strength
from training.tiny.trainer import LOG, Trainer, progress_of_row, read_checkpoint

CHECKPOINT = "checkpoint.safetensors"  # in --work
HEAD_STEPS = 200  # batches for the head on patch labels, which is not saved with a model


def train(args: argparse.Namespace) -> None:
    """Train, and write the model to --out."""
    params, kind = read_params_file(PARAMS_FILE, Params), ExampleKind(args.input, args.without_reasoning)
    checkpoint = args.work / CHECKPOINT
    torch.set_num_threads(args.threads)
    torch.set_float32_matmul_precision(args.matmul)
    args.work.mkdir(parents=True, exist_ok=True)
    trainer = Trainer(args.device, args.lr, args.muon_lr, args.patch_weight)
    starts = bool(args.start) and not has_checkpoint(checkpoint)
    if has_checkpoint(checkpoint):
        trainer.load(checkpoint)
        print(f"continues from step {trainer.progress.step}, {trainer.progress.seconds / 60:.1f} min", flush=True)
    elif starts:
        shutil.copy(args.start / LOG, args.work / LOG)
        trainer.progress = progress_of_row(read_rows(args.work / LOG)[-1], args.batch)
    progress = trainer.progress
    warm_up_from = progress.step if starts else progress.vision_steps
    minutes = progress.seconds / 60

    context = multiprocessing.get_context("spawn")
    source = context.Queue(maxsize=2 * args.workers + 2)
    noise = context.Value("d", noise_strength(minutes, args.noise_ramp))
    most = context.Value("i", max_objects(minutes, args.vision_only, args.few_objects))
    workers = [
        context.Process(
            target=generate, daemon=True, args=(params, kind, progress.chunk + i, args.workers, source, noise, most)
        )
        for i in range(args.workers)
    ]
    for worker in workers:
        worker.start()
    measured = MeasuredExamples(args.measured) if args.measured else None
    pool = Pool(args.pool, args.reuse, source, [], measured_share=args.measured_share if measured else 0.0)
    held: list[Example]
    if measured:
        held = measured.refresh()[: args.validation]
    else:
        held = make_examples(
            params, trainer.base.codec, kind, SUITE + "-held", range(args.validation), kind.without_reasoning < 1
        )

    rng = np.random.default_rng(progress.step)
    if starts:
        pool.fill(at_least=8 * args.batch)
        trainer.start_from(args.start, (pool.mosaics(rng, args.batch) for _ in range(HEAD_STEPS)))
    began, last_save, last_log = time.monotonic() - progress.seconds, time.monotonic(), -np.inf
    recent: list[tuple[float, float]] = []

    def log(share: float) -> None:
        losses = dict(zip(("train_loss", "patch_loss"), np.mean(recent or [(np.nan,) * 2], 0).tolist(), strict=True))
        row = {
            "step": progress.step,
            "clips": progress.step * args.batch,
            "fresh_clips": progress.chunk * CHUNK,
            "minutes": round(progress.seconds / 60, 2),
            "rate": round(share, 4),
            **losses,
        }
        row |= trainer.validate(held, args.batch)
        print({k: round(v, 6) for k, v in row.items()}, flush=True)
        append_row(args.work / LOG, row)

    while (elapsed := time.monotonic() - began) < 60 * args.minutes:
        before, minutes = minutes, elapsed / 60
        if before < args.minutes - args.decay <= minutes:
            trainer.save(args.work / "before_decay.safetensors")
        if measured and elapsed - last_log > args.log_seconds:
            pool.measured = measured.refresh()[args.validation :]
        noise.value = noise_strength(minutes, args.noise_ramp)
        pool.max_objects = most.value = max_objects(minutes, args.vision_only, args.few_objects)
        pool.fill(at_least=8 * args.batch)
        vision_only = minutes < args.vision_only
        step = progress.step if vision_only else progress.step - warm_up_from
        share = learning_rate(step, args.minutes - minutes, args.decay)
        if vision_only:
            recent.append(trainer.learn_patches(*pool.mosaics(rng, args.batch), share))
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
    for worker in workers:
        worker.terminate()


def export(work: Path, out: Path, kind: ExampleKind) -> None:
    """Write the model of the last checkpoint, trained on examples of this kind, and the log."""
    base, _ = read_checkpoint(work / CHECKPOINT)
    base.input = kind.model_input(read_params_file(PARAMS_FILE, Params))
    base.save(out)
    shutil.copy(work / LOG, out / LOG)
    print(f"saved to {out}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=90, help="of training in all, resumed runs included")
    parser.add_argument("--out", type=Path, default=Path("models/tiny"), help="where the model is written at the end")
    parser.add_argument(
        "--start", type=Path, help="folder of a trained model to continue, where --work has no checkpoint"
    )
    parser.add_argument("--work", type=Path, default=Path(".train/tiny"), help="checkpoint and log")
    parser.add_argument("--device", default="cpu", choices=("cpu", "cuda"))
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument(
        "--matmul",
        default="medium",
        choices=("highest", "high", "medium"),
        help="medium: matrix products in bfloat16, where the processor has it",
    )
    parser.add_argument("--workers", type=int, default=1, help="processes that make clips")
    parser.add_argument("--input", default="flow", choices=("flow", "rgb"), help="what the model is shown")
    parser.add_argument("--without-reasoning", type=float, default=0.25, help="share of the clips without reasoning")
    parser.add_argument(
        "--measured",
        type=Path,
        help="folder of examples by training.tiny.measured; the first --validation stay out",
    )
    parser.add_argument("--measured-share", type=float, default=0.5, help="of the drawn clips that are from --measured")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--lr", type=float, default=1.5e-3, help="peak, of AdamW")
    parser.add_argument("--muon-lr", type=float, default=4e-3, help="peak, of Muon, for the hidden matrices")
    parser.add_argument("--patch-weight", type=float, default=0.5, help="of the loss on patch labels")
    parser.add_argument("--vision-only", type=float, default=30, help="minutes with the vision tower only")
    parser.add_argument("--noise-ramp", type=float, default=30, help="minutes until the flow is as noisy as RAFT's")
    parser.add_argument("--few-objects", type=float, default=30, help="minutes with 1, 2, 3 objects after these")
    parser.add_argument("--decay", type=float, default=20, help="minutes at the end with a falling learning rate")
    parser.add_argument("--pool", type=int, default=4000, help="clips in memory, 0.7 MB each")
    parser.add_argument("--reuse", type=float, default=4.0, help="draws of a clip on average")
    parser.add_argument("--validation", type=int, default=64)
    parser.add_argument("--log-seconds", type=float, default=120)
    parser.add_argument("--save-seconds", type=float, default=180)
    parser.add_argument("--export", action="store_true", help="write the last checkpoint to --out and train nothing")
    args = parser.parse_args()
    if args.export:
        export(args.work, args.out, ExampleKind(args.input, args.without_reasoning))
    else:
        train(args)


if __name__ == "__main__":
    main()
