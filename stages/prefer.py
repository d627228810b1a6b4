"""Preference optimisation (DPO) of the fine-tuned model on clips of a target domain, without labels.

Reads data/finetune/model and of the suite prefer.suite data/render (masks) and data/flow. Writes data/prefer: which
model answers from now on and which clips it has used (answering_model.json), curve.csv (plots, through `score`); where
enabled, model (a checkpoint) and pairs.json. An interrupted run goes on from its pairs and its last checkpoint.
Parameters: seed, clip, flow (but noise and train_source), model.base, model.input, model.sees,
model.reasoning, model.dtype, search.width,
search.height, prefer, training, infer.shots. Run: python -m stages.prefer
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.csv_rows import write_rows
from pipeline.errors import ParamsError
from pipeline.model.model_input import ModelInput, is_words
from pipeline.model.processes import in_processes, is_first
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.keep_folder import keep_folder
from stages.graph.answering_model import CURVE, FINETUNED, FOLDER, AnsweringModel, split_clips
from stages.graph.clip_pictures import check_input
from stages.graph.params import PreferSettings
from stages.graph.run import folder, run
from stages.graph.shown_clip import shown_stages, shown_to
from stages.graph.stage_params import load
from stages.graph.training_processes import processes_for

if TYPE_CHECKING:
    from pipeline.model.answering import Shown
    from pipeline.model.base import Base
    from pipeline.model.preference import Pair
    from pipeline.model.sampling import Sampling
    from pipeline.model.words_model import WordsModel
    from pipeline.scene.scene import Scene

COLUMNS = ("step", "loss", "accuracy", "margin")
PAIRS = "pairs.json"


@dataclass(frozen=True)
class Parameters:
    """What `make` needs.

    Attributes:
        seed: Of the sampled answers and the training.
        schedule: The frames of a clip.
        input: What the model is shown: flow or rgb.
        sees: Bodies one by one, or whole frames.
        reasoning: Whether <think> precedes <answer>.
        dtype: Of the model's weights.
        size: Width and height at which answers are compared with a clip, px.
        used: The clips that may be used.
        settings: The section `prefer`.
        processes: That train together.
    """

    seed: int
    schedule: Schedule
    input: str
    sees: str
    reasoning: bool
    dtype: str
    size: tuple[int, int]
    used: tuple[int, ...]
    settings: PreferSettings
    processes: int


def skip(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: None) -> dict[str, float]:
    """Not enabled: the fine-tuned model answers."""
    write_rows(output / CURVE, [], COLUMNS)
    AnsweringModel(False).write(output)
    return {}


def make(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: Parameters) -> dict[str, float]:
    # imported here, as below: it takes seconds, and by default there is nothing to do
    from pipeline.inference.answers import answer_seed
    from pipeline.model.answering import load_answering
    from pipeline.model.preference import draw_answers, rank_pairs, weighted_reward
    from pipeline.search.best_of_k import rank
    from stages.graph.search_target import shard_evaluator

    rendered, flow = inputs
    p, own, schedule = parameters, parameters.settings, parameters.schedule

    def judge(clip: int, scenes: "Sequence[Scene]") -> np.ndarray:
        evaluator = shard_evaluator(rendered[clip].shard, flow[clip].shard, clip, schedule, p.size)
        rewards = rank(evaluator, scenes).rewards
        return weighted_reward(rewards, own.epe_weight)

    if not (scratch / PAIRS).is_file():
        base = load_answering(str(FINETUNED), frames=schedule.model_frames, dtype=p.dtype)
        seeds = {c: answer_seed(p.seed, "prefer", own.suite, c) for c in p.used}
        answers = draw_answers(base, shown(base, inputs, p), sampling(p), seeds, own.decode_batch_size)
        write_pairs(scratch / PAIRS, rank_pairs(answers, judge, own.margin, own.pairs))
    return in_processes(train_in_each, p.processes, output, scratch, inputs, p)


def train_in_each(
    output: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: Parameters
) -> dict[str, float]:
    """The work of each process of the training; the first one writes the output."""
    from transformers.utils import logging

    from pipeline.model.answering import load_answering
    from pipeline.model.preference import Pair, prefer
    from pipeline.model.training_plan import TrainingPlan

    p, own = parameters, parameters.settings
    base = load_answering(str(FINETUNED), frames=p.schedule.model_frames, dtype=p.dtype)
    pairs = [Pair.read(row) for row in json.loads((scratch / PAIRS).read_text())]
    rows: list[dict[str, Any]] = []
    if pairs:
        logging.set_verbosity_error()
        plan = TrainingPlan(
            steps=own.steps,
            epochs=1.0,
            batch_size=own.batch_size,
            learning_rate=own.learning_rate,
            lora_rank=own.lora_rank,
            checkpoint_steps=own.checkpoint_steps,
            seed=p.seed,
            processes=p.processes,
        )
        prefer(base, pairs, shown(base, inputs, p), own.beta, sampling(p), plan, scratch, rows.append)
    if not is_first():
        return {}
    base.save(output / "model")
    write_pairs(output / PAIRS, pairs)
    write_rows(output / CURVE, [row for row in rows if "loss" in row], COLUMNS)
    AnsweringModel(True, own.suite, p.used).write(output)
    return {"clips": len(p.used), "pairs": len(pairs)}


def shown(base: "Base | WordsModel", inputs: Sequence[ShardedDataset], p: Parameters) -> "dict[int, Shown]":
    """What the model sees of the clips that may be used."""
    from pipeline.model.words_model import WordsModel

    stages = dict(zip(("render", "flow"), inputs, strict=True))
    shown = [stages[s] for s in shown_stages(p.input, p.sees, isinstance(base, WordsModel))]
    return {c: shown_to(base, [stage[c] for stage in shown], p.input, p.sees, p.schedule) for c in p.used}


def sampling(p: Parameters) -> "Sampling":
    """How answers are drawn."""
    from pipeline.model.sampling import Sampling

    return Sampling(
        samples=p.settings.samples,
        temperature=p.settings.temperature,
        top_p=p.settings.top_p,
        reasoning=p.reasoning,
        seconds=p.schedule.seconds,
        numbers="tokens",
    )


def write_pairs(path: Path, pairs: "Sequence[Pair]") -> None:
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps([asdict(pair) for pair in pairs], indent=1) + "\n")
    partial.replace(path)


def main() -> None:
    params = load("prefer")
    own, m, f = params.prefer, params.model, params.flow
    if not own.enabled:
        keep_folder("prefer", FOLDER, skip, parameters=None)
        return
    if params.infer.shots:
        raise ParamsError(
            f"`prefer.enabled` is true and `infer.shots` is {params.infer.shots}; valid: one of the two, "
            "since with a prompt no model is fine-tuned that could be trained on"
        )
    words = is_words(m.base)
    picture = None if words else f.picture
    shown = ModelInput.of(m.input, picture, f.source, (f.width, f.height), f.iterations, m.reasoning, m.sees)
    check_input(str(FINETUNED), shown, required=True)
    inputs = [folder("render", own.suite), folder("flow", own.suite)]
    clips = len(open_shards(inputs[0]))
    if own.clips >= clips:
        raise ParamsError(
            f"`prefer.clips` is {own.clips}, but {own.suite} has {clips} clips; valid: fewer than these, "
            "since scores are shown on clips that it did not use"
        )
    parameters = Parameters(
        seed=params.seed,
        schedule=params.clip.schedule,
        input=m.input,
        sees=m.sees,
        reasoning=m.reasoning,
        dtype=m.dtype,
        size=(params.search.width, params.search.height),
        used=split_clips(np.random.default_rng(params.seed), clips, own.clips),
        settings=own,
        processes=processes_for(params, "prefer"),
    )
    keep_folder(
        "prefer",
        FOLDER,
        make,
        parameters=parameters,
        inputs=inputs,
        files={"model": FINETUNED},
        versions=["torch", "transformers", "peft", "accelerate", "mujoco", "numba"],
    )


if __name__ == "__main__":
    run(main)
