"""Fine-tune the base model on the training clips.

Reads data/tokenize and data/flow (data/render with model.input=rgb) of train and val, model.base. Writes data/finetune:
model (a checkpoint), loss.csv and eval_loss.csv (plots). An interrupted run goes on from its last checkpoint. With
infer.shots the base answers as it is: nothing is trained, and there is no model.
Parameters: seed, clip, model, finetune, infer.shots. Run: python -m stages.finetune
"""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pipeline.model.clip_dataset import ClipDataset
from transformers.utils import logging

from pipeline.language.codec import Tokens
from pipeline.model.base import load_base
from pipeline.model.finetune import finetune
from pipeline.model.patches import resize_frames
from pipeline.model.trainer import TrainingPlan
from pipeline.shards.dataset import ShardedDataset
from pipeline.shards.keep_folder import keep_folder
from stages.graph.clip_pictures import picture_stage, pictures
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import DATA, folder


def make(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], p: Mapping[str, Any]) -> dict[str, float]:
    m, plan = p["model"], TrainingPlan(**p["finetune"], seed=p["seed"])
    base = load_base(m["base"], m["width"], m["height"], p["clip"]["model_frames"], m["dtype"])

    def dataset(tokens: ShardedDataset, source: ShardedDataset) -> ClipDataset:
        def read(index: int) -> tuple[Tokens, np.ndarray]:
            row = tokens[index].row()
            free, numeric = np.array(row["free"]), np.array(row["numeric"])
            frames = pictures(source[index], m["input"], p["clip"])
            return (Tokens(np.array(row["ids"], np.int32), row["prompt_length"], free, numeric),
                    resize_frames(frames, base.layout.width, base.layout.height))  # fmt: skip

        return ClipDataset(len(tokens), read)

    train_tokens, train_pictures, val_tokens, val_pictures = inputs
    rows: list[dict] = []
    logging.set_verbosity_error()
    finetune(base, dataset(train_tokens, train_pictures), dataset(val_tokens, val_pictures), plan, scratch, rows.append)
    base.save(output / "model")
    write_curve(output / "loss.csv", rows, "loss")
    write_curve(output / "eval_loss.csv", rows, "eval_loss")
    losses = [row["eval_loss"] for row in rows if "eval_loss" in row]
    return {"steps": rows[-1]["step"], "validation loss before": round(losses[0], 4), "after": round(losses[-1], 4)}


def keep(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], p: Mapping[str, Any]) -> dict[str, float]:
    """With infer.shots: no model, empty curves."""
    write_curve(output / "loss.csv", [], "loss")
    write_curve(output / "eval_loss.csv", [], "eval_loss")
    return {}


def write_curve(path: Path, rows: list[dict], column: str) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["step", column])
        writer.writerows([row["step"], round(row[column], 6)] for row in rows if column in row)


def main() -> None:
    params = load("finetune")
    if params.infer.shots:
        keep_folder("finetune", DATA / "finetune", keep, parameters={"trained": False})
        return
    m = params.model
    parameters = {"seed": params.seed, "clip": params.clip.model_dump(), "model": m.model_dump(),
                  "finetune": params.finetune.model_dump()}  # fmt: skip
    inputs = [folder(stage, suite) for suite in ("train", "val") for stage in ("tokenize", picture_stage(m.input))]
    files = {"base": Path(m.base)} if Path(m.base).is_dir() else {}
    keep_folder("finetune", DATA / "finetune", make, parameters=parameters, inputs=inputs, files=files,
                versions=["torch", "transformers", "peft", "accelerate"])  # fmt: skip


if __name__ == "__main__":
    run(main)
