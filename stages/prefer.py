"""Preference optimisation (DPO) of the fine-tuned model on clips of a target domain, without labels.

Reads data/finetune/model and of the suite prefer.suite data/render (masks) and data/flow. Writes data/prefer: which
model answers from now on and which clips it has used (answering_model.json), curve.csv (plots, through `score`); where
enabled, model (a checkpoint) and pairs.json. An interrupted run goes on from its pairs and its last checkpoint.
Parameters: seed, clip, model.input, model.reasoning, model.dtype, search.width, search.height, prefer, infer.shots.
Run: python -m stages.prefer
"""

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.errors import ParamsError
from pipeline.shards.dataset import ShardedDataset, open_shards
from pipeline.shards.keep_folder import keep_folder
from stages.graph.answering_model import CURVE, FINETUNED, FOLDER, AnsweringModel, split_clips
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import folder

if TYPE_CHECKING:
    from pipeline.model.preference import Pair
    from pipeline.scene.scene import Scene

COLUMNS = ("step", "loss", "accuracy", "margin")


def keep(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], p: Mapping[str, Any]) -> dict[str, float]:
    """Not enabled: the fine-tuned model answers."""
    write_curve(output, [])
    AnsweringModel(False).write(output)
    return {}


def make(output: Path, scratch: Path, inputs: Sequence[ShardedDataset], p: Mapping[str, Any]) -> dict[str, float]:
    # imported here: it takes seconds, and by default there is nothing to do
    from pipeline.model.walker import Tries
    from transformers.utils import logging

    from pipeline.clips.schedule import Schedule
    from pipeline.model.base import load_base
    from pipeline.model.generate import Sampling
    from pipeline.model.patches import resize_frames
    from pipeline.model.preference import Pair, draw_answers, prefer, rank_pairs, weighted_reward
    from pipeline.model.trainer import TrainingPlan
    from pipeline.search.best_of_k import rank
    from pipeline.search.evaluator import Evaluator
    from stages.graph.clip_pictures import picture_stage, pictures
    from stages.graph.search_target import search_target

    rendered, flow = inputs
    base = load_base(p["model"], frames=p["clip"]["model_frames"], dtype=p["dtype"])
    tries = Tries(base.codec)
    source = {"flow": flow, "render": rendered}[picture_stage(p["input"])]
    size = base.layout.width, base.layout.height
    shown = {c: resize_frames(pictures(source[c], p["input"], p["clip"]), *size) for c in p["used"]}
    sampling = Sampling(p["samples"], p["temperature"], p["top_p"], p["reasoning"], p["clip"]["seconds"], "tokens")

    def judge(clip: int, scenes: "Sequence[Scene]") -> np.ndarray:
        target = search_target(rendered[clip].shard, flow[clip].shard, clip, p)
        rewards = rank(Evaluator(target, Schedule(**p["clip"]), threads=1), scenes).rewards
        return weighted_reward(rewards, p["epe_weight"])

    drawn = scratch / "pairs.json"
    if not drawn.is_file():
        seeds = {c: zlib.crc32(f"{p['seed']} prefer {p['suite']} {c}".encode()) for c in p["used"]}
        answers = draw_answers(base, shown, sampling, seeds, p["decoded"], tries)
        write_pairs(drawn, rank_pairs(answers, judge, p["margin"], p["pairs"]))
    pairs = [Pair(**row) for row in json.loads(drawn.read_text())]
    rows: list[dict[str, Any]] = []
    if pairs:
        logging.set_verbosity_error()
        plan = TrainingPlan(**p["plan"], seed=p["seed"])
        prefer(base, pairs, shown, p["beta"], sampling, plan, scratch, rows.append, tries)
    base.save(output / "model")
    write_pairs(output / "pairs.json", pairs)
    write_curve(output, rows)
    AnsweringModel(True, p["suite"], tuple(p["used"])).write(output)
    return {"clips": len(p["used"]), "pairs": len(pairs)}


def write_curve(folder: Path, rows: Sequence[Mapping[str, float]]) -> None:
    lines = [",".join(COLUMNS), *(",".join(f"{row[c]:.6g}" for c in COLUMNS) for row in rows if "loss" in row)]
    (folder / CURVE).write_text("\n".join(lines) + "\n")


def write_pairs(path: Path, pairs: "Sequence[Pair]") -> None:
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps([asdict(pair) for pair in pairs], indent=1) + "\n")
    partial.replace(path)


def main() -> None:
    params = load("prefer")
    own, m = params.prefer, params.model
    if not own.enabled:
        keep_folder("prefer", FOLDER, keep, parameters={"enabled": False})
        return
    if params.infer.shots:
        raise ParamsError(f"`prefer.enabled` is true and `infer.shots` is {params.infer.shots}; valid: one of the two, "
                          "since with a prompt no model is fine-tuned that could be trained on")  # fmt: skip
    inputs = [folder("render", own.suite), folder("flow", own.suite)]
    clips = len(open_shards(inputs[0]))
    if own.clips >= clips:
        raise ParamsError(f"`prefer.clips` is {own.clips}, but {own.suite} has {clips} clips; valid: fewer than these, "
                          "since scores are shown on clips that it did not use")  # fmt: skip
    parameters = {
        "seed": params.seed, "clip": params.clip.model_dump(), "input": m.input, "reasoning": m.reasoning,
        "dtype": m.dtype, "model": str(FINETUNED), "width": params.search.width, "height": params.search.height,
        "suite": own.suite, "used": split_clips(np.random.default_rng(params.seed), clips, own.clips),
        "samples": own.samples, "temperature": own.temperature, "top_p": own.top_p, "decoded": own.decoded,
        "epe_weight": own.epe_weight, "margin": own.margin, "pairs": own.pairs, "beta": own.beta,
        "plan": {"steps": own.steps, "epochs": 1.0, "batch_size": own.batch_size, "learning_rate": own.learning_rate,
                 "lora_rank": own.lora_rank, "checkpoint_steps": own.checkpoint_steps},
    }  # fmt: skip
    keep_folder("prefer", FOLDER, make, parameters=parameters, inputs=inputs, files={"model": FINETUNED},
                versions=["torch", "transformers", "peft", "accelerate", "mujoco", "numba"])  # fmt: skip


if __name__ == "__main__":
    run(main)
