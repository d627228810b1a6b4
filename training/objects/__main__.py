"""Train the model that reads objects on examples kept in files.

    python -m training.objects.shards EXAMPLES
    python -m training.objects EXAMPLES --development DEVELOPMENT --minutes 240 --out models/objects

The training ends after --minutes, and the learning rate falls to zero in the last --decay of them. It writes a
checkpoint to --work every few minutes, and a run that finds one continues it; with more --minutes, a finished training
goes on at full rate from `before_decay.safetensors`. At fixed numbers of clips it keeps the averaged weights
(clips-N.safetensors). `log.csv` in --work has the losses, also on the examples of --development.
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

import numpy as np
import torch

from pipeline.csv_rows import append_row
from pipeline.model.model_input import ModelInput
from pipeline.objects.answering import ObjectsModel
from pipeline.objects.batch import Examples, groups_of, loss_sums, mean_losses
from pipeline.objects.network import ObjectsNetwork, ObjectsSize
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from training.objects.shards import SUITE, read_examples
from training.objects.trainer import Pool, Trainer

KEPT = (2_000, 5_000, 10_000, 20_000, 40_000, 80_000, 120_000, 160_000, 240_000, 320_000, 480_000, 640_000, 1_280_000)
WARM_STEPS = 50
LOG_STEPS = 100
SAVE_SECONDS = 300


def train(asked: argparse.Namespace) -> None:
    """Train, and write the model to --out."""
    torch.set_num_threads(1)
    torch.set_float32_matmul_precision(asked.matmul)
    torch.manual_seed(asked.seed)
    asked.work.mkdir(parents=True, exist_ok=True)
    size = ObjectsSize(width=asked.width, own_blocks=asked.own_blocks, blocks=asked.blocks)
    trainer = Trainer(ObjectsNetwork(size), asked.rate, asked.muon_rate)
    seconds, clips = 0.0, 0
    checkpoint, before = asked.work / "checkpoint.safetensors", asked.work / "before_decay.safetensors"
    if has_checkpoint(checkpoint):
        state = load_checkpoint(checkpoint)
        if state["share"] < 1 and state["seconds"] < 60 * (asked.minutes - asked.decay) and before.is_file():
            state = load_checkpoint(before)
        trainer.load(state)
        seconds, clips = state["seconds"], state["clips"]
        print(f"continues from {clips} clips, {seconds / 60:.1f} min", flush=True)
    pool, rng = Pool(asked.examples, asked.files, asked.visits), np.random.default_rng((asked.seed, trainer.step))
    development = read_examples(min(asked.development.glob("*.parquet"))) if asked.development else None
    sums: dict[str, float] = {}
    began, saved, share = time.monotonic() - seconds, time.monotonic(), 1.0
    while (seconds := time.monotonic() - began) < 60 * asked.minutes:
        left = 60 * asked.minutes - seconds
        earlier, share = share, min(1.0, left / (60 * asked.decay)) * min(1.0, (trainer.step + 1) / WARM_STEPS)
        if share < 1 <= earlier and trainer.step > WARM_STEPS:
            write_state(before, trainer, seconds, clips, 1.0)
        for _ in range(1 if pool.loaded else 8):
            pool.refresh()
        losses = trainer.learn(pool.draw(asked.batch, rng), share, rng)
        reached = clips + asked.batch
        for name, value in losses.items():
            sums[name] = sums.get(name, 0.0) + value / LOG_STEPS
        for kept in KEPT:
            if clips < kept <= reached:
                state = {"network": trainer.averaged, "size": vars(size), "clips": kept}
                save_checkpoint(asked.work / f"clips-{kept}.safetensors", state)
        clips = reached
        if trainer.step % LOG_STEPS == 0:
            row = {"clips": clips, "files": len(pool.times_read), "minutes": seconds / 60, "rate": share, **sums}
            if development is not None and trainer.step % (5 * LOG_STEPS) == 0:
                row |= held_out_losses(trainer, size, development)
            print({k: round(v, 4) for k, v in row.items()}, flush=True)
            columns = ("clips", "files", "minutes", "rate", "scene", "shape", "numbers", "frames")
            append_row(asked.work / "log.csv", {c: round(row[c], 4) for c in columns})
            sums = {}
        if time.monotonic() - saved > SAVE_SECONDS:
            saved = time.monotonic()
            write_state(checkpoint, trainer, seconds, clips, share)
    write_state(checkpoint, trainer, seconds, clips, share)
    trainer.network.load_state_dict(trainer.averaged)
    f = read_params_file(PARAMS_FILE, Params).flow
    shown = ModelInput.of("objects", f.picture, "exact", (f.width, f.height), f.iterations, reasoning=True)
    ObjectsModel(trainer.network, shown).save(asked.out)
    shutil.copyfile(asked.work / "log.csv", asked.out / "log.csv")
    print(f"saved to {asked.out}", flush=True)


def write_state(path: Path, trainer: Trainer, seconds: float, clips: int, share: float) -> None:
    """Write what a training continues from, whole or not at all."""
    save_checkpoint(path, {**trainer.state(), "seconds": seconds, "clips": clips, "share": share})


@torch.no_grad()
def held_out_losses(trainer: Trainer, size: ObjectsSize, examples: Examples) -> dict[str, float]:
    """Mean losses of the averaged weights on the examples."""
    network = ObjectsNetwork(size)
    network.load_state_dict(trainer.averaged)
    groups, rng = list(groups_of(examples, np.arange(len(examples.count)))), np.random.default_rng(0)
    means = mean_losses(groups, [loss_sums(network, group, rng) for group in groups])
    return {f"held {name}": float(value) for name, value in means.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("examples", type=Path, help=f"folder of training.objects.shards, of the suite {SUITE}")
    parser.add_argument("--development", type=Path, help="likewise, of another seed")
    parser.add_argument("--minutes", type=float, default=240, help="of training in all, resumed runs included")
    parser.add_argument("--decay", type=float, default=60, help="minutes at the end with a falling learning rate")
    parser.add_argument(
        "--out", type=Path, default=Path("models/objects"), help="where the model is written at the end"
    )
    parser.add_argument("--work", type=Path, default=Path(".train/objects"), help="checkpoints and log")
    parser.add_argument("--matmul", default="medium", choices=("highest", "high", "medium"))
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--rate", type=float, default=1.5e-3, help="peak, of AdamW")
    parser.add_argument("--muon-rate", type=float, default=4e-3, help="peak, of Muon")
    parser.add_argument("--files", type=int, default=80, help="in memory, 25 MB each")
    parser.add_argument("--visits", type=float, default=2.0, help="of a file before another takes its place")
    parser.add_argument("--width", type=int, default=192)
    parser.add_argument("--own-blocks", type=int, default=2)
    parser.add_argument("--blocks", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    train(parser.parse_args())


if __name__ == "__main__":
    main()
