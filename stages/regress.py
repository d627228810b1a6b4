"""The baseline without language: ViViT that regresses scenes as vectors of fixed length.

Reads data/sample and data/flow (data/render with model.input=rgb) of train and val, and the pictures of id, held_out,
more and real. Writes data/regress: model (loss.csv and eval_loss.csv; where enabled a checkpoint), and where enabled
data/regress/<suite> for these four: clip, scene. An interrupted run goes on from its last checkpoint.
Parameters: seed, clip, model.input, sample.distribution, regress. Run: python -m stages.regress
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import write_rows
from pipeline.scene.sample import Distribution
from pipeline.shards.dataset import ShardedDataset
from pipeline.shards.keep_folder import keep_folder
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.clip_pictures import picture_stage, pictures
from stages.graph.params import RegressSettings
from stages.graph.run import DATA, folder, run, run_shards
from stages.graph.stage_params import load

if TYPE_CHECKING:
    from pipeline.model.scene_vector import SceneVector
    from pipeline.model.vivit import Regressor

SUITES = ("id", "held_out", "more", "real")
MODEL = DATA / "regress" / "model"
SCHEMA = pa.schema({"clip": pa.int64(), "scene": pa.string()})
CURVES = {"loss.csv": "loss", "eval_loss.csv": "eval_loss"}


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs; distribution: the ranges to which the numbers of a scene are scaled."""

    schedule: Schedule
    input: str
    distribution: Distribution


@dataclass(frozen=True)
class TrainingParameters(Parameters):
    """What `make` needs beside; settings: the section `regress`."""

    seed: int
    settings: RegressSettings


def skip(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: None) -> dict[str, float]:
    """Not enabled: empty curves."""
    write_curves(output, [])
    return {}


def make(
    output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: TrainingParameters
) -> dict[str, float]:
    # imported here: it takes seconds, and by default there is nothing to do
    from transformers.utils import logging

    from pipeline.model.patches import resize_frames
    from pipeline.model.scene_vector import encode, scale_of
    from pipeline.model.trainer import ClipDataset
    from pipeline.model.training_plan import TrainingPlan
    from pipeline.model.vivit import VivitSize, build_regressor, regress
    from pipeline.scene.text import read_scene

    p, own, frames = parameters, parameters.settings, parameters.schedule.model_frames
    size = VivitSize(
        width=own.width, height=own.height, frames=frames, hidden=own.hidden, layers=own.layers, heads=own.heads
    )
    scale = scale_of(p.distribution)

    def dataset(scenes: ShardedDataset, source: ShardedDataset) -> "ClipDataset[tuple[np.ndarray, SceneVector]]":
        def read(index: int) -> "tuple[np.ndarray, SceneVector]":
            shown = resize_frames(pictures(source[index], p.input, p.schedule), size.width, size.height)
            return shown, encode(read_scene(scenes[index].row()["scene"]), scale)

        return ClipDataset(len(scenes), read)

    train_scenes, train_pictures, val_scenes, val_pictures = inputs
    rows: list[dict[str, Any]] = []
    logging.set_verbosity_error()
    regressor = build_regressor(size, p.seed)
    plan = TrainingPlan(
        steps=own.steps,
        epochs=own.epochs,
        batch_size=own.batch_size,
        learning_rate=own.learning_rate,
        lora_rank=0,
        checkpoint_steps=own.checkpoint_steps,
        seed=p.seed,
    )
    regress(
        regressor, dataset(train_scenes, train_pictures), dataset(val_scenes, val_pictures), plan, scratch, rows.append
    )
    regressor.model.save_pretrained(output)
    write_curves(output, rows)
    losses = [row["eval_loss"] for row in rows if "eval_loss" in row]
    before, after = round(losses[0], 4), round(losses[-1], 4)
    return {"steps": rows[-1]["step"], "validation loss before": before, "validation loss after": after}


@lru_cache(maxsize=1)
def model(path: Path) -> "Regressor":
    from pipeline.model.vivit import load_regressor

    return load_regressor(path)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    from pipeline.model.patches import resize_frames
    from pipeline.model.scene_vector import scale_of
    from pipeline.model.vivit import answer, picture_size
    from pipeline.scene.text import write_scene
    from pipeline.shards.dataset import Clip

    (source,) = inputs
    p, scale = parameters, scale_of(parameters.distribution)
    regressor = model(MODEL)
    size = picture_size(regressor)
    shown = [resize_frames(pictures(Clip(c, source), p.input, p.schedule), *size) for c in shard.clips]
    scenes = answer(regressor, np.stack(shown), scale)
    rows = [{"clip": c, "scene": write_scene(scene)} for c, scene in zip(shard.clips, scenes, strict=True)]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def write_curves(output: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    for name, column in CURVES.items():
        write_rows(output / name, [row for row in rows if column in row], ("step", column))


def main() -> None:
    params = load("regress")
    own = params.regress
    kind = params.model.input
    source = picture_stage(kind)
    if not own.enabled:
        keep_folder("regress", MODEL, skip, parameters=None)
        return
    distribution = Distribution(**params.sample.distribution.model_dump())
    shown = Parameters(params.clip.schedule, kind, distribution)
    parameters = TrainingParameters(shown.schedule, shown.input, distribution, params.seed, own)
    inputs = [folder(stage, suite) for suite in ("train", "val") for stage in ("sample", source)]
    keep_folder(
        "regress", MODEL, make, parameters=parameters, inputs=inputs, versions=["torch", "transformers", "accelerate"]
    )
    for suite in SUITES:
        run_shards(
            "regress", suite, compute, shown, [source], files={"model": MODEL}, versions=["torch", "transformers"]
        )


if __name__ == "__main__":
    run(main)
