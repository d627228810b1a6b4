"""Fine-tune the base model on the training clips.

Reads of train and val data/sample, data/simulate, data/events, data/render and data/flow (for a model with a tokenizer
data/tokenize, and for whole frames data/flow, or data/render with model.input=rgb, alone); model.base. Writes
data/finetune: model (a checkpoint, whose model_input.json records how its input is made), loss.csv and eval_loss.csv
(plots). An interrupted run goes on from its last checkpoint. With infer.shots the base answers as it is: nothing is
trained, and there is no model.
Parameters: seed, clip, flow (but source, raft and noise), model, finetune, training,
infer.shots. Run: python -m stages.finetune
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.clips.events import event_of_row
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import trace_pairs
from pipeline.csv_rows import write_rows
from pipeline.errors import naming
from pipeline.model.model_input import ModelInput, is_words
from pipeline.model.processes import in_processes, is_first
from pipeline.model.training_plan import TrainingPlan
from pipeline.physics.trace_shards import read_trace
from pipeline.scene.text import read_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.dataset import ShardedDataset
from pipeline.shards.keep_folder import keep_folder
from stages.graph.params import ModelSettings
from stages.graph.run import DATA, folder, run
from stages.graph.shown_clip import seen_of_clip, shown_stages, shown_to
from stages.graph.stage_params import load
from stages.graph.training_processes import processes_for

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.language.codec import Tokens
    from pipeline.model.trainer import ClipDataset
    from pipeline.model.words_example import Arrays

CURVES = ("loss", "eval_loss")


@dataclass(frozen=True)
class Parameters:
    """What `make` needs.

    Attributes:
        schedule: The frames of a clip.
        model: The section `model`.
        shown: How the pictures of the training clips are made, which the checkpoint records.
        plan: Of the training.
    """

    schedule: Schedule
    model: ModelSettings
    shown: ModelInput
    plan: TrainingPlan


def make(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: Parameters) -> dict[str, float]:
    return in_processes(make_in_each, parameters.plan.processes, output, scratch, inputs, parameters)


def make_in_each(
    output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: Parameters
) -> dict[str, float]:
    """The work of each process of the training; the first one writes the output."""
    # imported here, as below: it takes seconds, and mostly the model is in the store
    from transformers.utils import logging

    from pipeline.model.answering import load_answering
    from pipeline.model.finetune import finetune
    from pipeline.model.words_finetune import finetune_words
    from pipeline.model.words_model import WordsModel

    m, schedule = parameters.model, parameters.schedule
    with naming("model.base"):
        base = load_answering(m.base, *m.size, schedule.model_frames, m.dtype)
    rows: list[dict] = []
    logging.set_verbosity_error()
    if isinstance(base, WordsModel):
        clips, val = (words_dataset(part, parameters) for part in (inputs[:5], inputs[5:]))
        finetune_words(base, clips, val, m.input == "rgb", parameters.plan, scratch, rows.append)
    else:
        half = len(inputs) // 2
        clips, val = (text_dataset(part, base, parameters) for part in (inputs[:half], inputs[half:]))
        finetune(base, clips, val, parameters.plan, scratch, rows.append)
    if not is_first():
        return {}
    base.input = parameters.shown
    base.save(output / "model")
    for column in CURVES:
        write_rows(output / f"{column}.csv", [row for row in rows if column in row], ("step", column))
    losses = [row["eval_loss"] for row in rows if "eval_loss" in row]
    before, after = round(losses[0], 4), round(losses[-1], 4)
    return {"steps": rows[-1]["step"], "validation loss before": before, "validation loss after": after}


def text_dataset(inputs: Sequence[ShardedDataset], base: "Base", parameters: Parameters) -> "ClipDataset":
    """Clips as tokens and videos. inputs: tokenize, and the stages that have what is shown."""
    from pipeline.model.language.codec import Tokens
    from pipeline.model.question import Question
    from pipeline.model.trainer import ClipDataset

    tokens, *sources = inputs
    m = parameters.model

    def read(index: int) -> "tuple[Tokens, np.ndarray]":
        row = tokens[index].row()
        free, numeric = np.array(row["free"]), np.array(row["numeric"])
        written = Tokens(np.array(row["ids"], np.int32), row["prompt_length"], free, numeric)
        shown = shown_to(base, [source[index] for source in sources], m.input, m.sees, parameters.schedule)
        if isinstance(shown, Question):
            return written.behind(shown.ids), shown.videos
        assert isinstance(shown, np.ndarray)
        return written, shown[None]

    return ClipDataset(len(tokens), read)


def words_dataset(inputs: Sequence[ShardedDataset], parameters: Parameters) -> "ClipDataset":
    """Clips as bodies, with masks as a network for masks finds them, or frames; and answers that are right.

    inputs: sample, simulate, events, render and flow.
    """
    from pipeline.model.mask_errors import with_errors
    from pipeline.model.shown import SeenFrames
    from pipeline.model.trainer import ClipDataset
    from pipeline.model.words_example import bodies_example, frames_example, motions, truth_of

    sample, simulated, happened, rendered, flow = inputs
    schedule, seed, m = parameters.schedule, parameters.plan.seed, parameters.model
    reasons = [m.reasoning]

    def read(index: int) -> "Arrays":
        scene = read_scene(sample[index].row()["scene"])
        clip = simulated[index]
        poses = trace_pairs(read_trace(clip.shard, clip.index), schedule)
        motion = motions(*poses, 1 / schedule.fps)
        events = [event_of_row(row) for row in happened[index].rows("events")]
        truth = truth_of(scene, motion, events, schedule.seconds)
        rng = clip_rng(seed, sample.folder.name, index, "masks")
        worsen = partial(with_errors, objects=len(scene.objects), rng=rng)
        seen = seen_of_clip(rendered[index], flow[index], m.input, m.sees, schedule, worsen)
        if isinstance(seen, SeenFrames):
            return frames_example(seen, truth, reasons)
        return bodies_example(seen, truth, reasons, rng)

    return ClipDataset(len(sample), read)


def skip(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: None) -> dict[str, float]:
    """With infer.shots: no model, empty curves."""
    for column in CURVES:
        write_rows(output / f"{column}.csv", [], ("step", column))
    return {}


def main() -> None:
    params = load("finetune")
    if params.infer.shots:
        keep_folder("finetune", DATA / "finetune", skip, parameters=None)
        return
    m, f = params.model, params.flow
    words = is_words(m.base)
    picture = None if words else f.picture
    shown = ModelInput.of(m.input, picture, f.train_source, (f.width, f.height), f.iterations, m.reasoning, m.sees)
    processes = processes_for(params, "finetune")
    plan = TrainingPlan(**params.finetune.model_dump(), seed=params.seed, processes=processes)
    parameters = Parameters(params.clip.schedule, m, shown, plan)
    labels = ["sample", "simulate", "events"] if words else ["tokenize"]
    read = [*labels, *shown_stages(m.input, m.sees, words)]
    inputs = [folder(stage, suite) for suite in ("train", "val") for stage in read]
    files = {"base": Path(m.base)} if Path(m.base).is_dir() else {}
    keep_folder(
        "finetune",
        DATA / "finetune",
        make,
        parameters=parameters,
        inputs=inputs,
        files=files,
        versions=["torch", "transformers", "peft", "accelerate"],
    )


if __name__ == "__main__":
    run(main)
