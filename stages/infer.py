"""Completions of clips: one greedy and K sampled, under the grammar, so that every answer parses.

Reads the model that answers (data/finetune/model, or with prefer.enabled data/prefer/model) and data/flow/<suite> (or
data/render/<suite> with model.input=rgb). With infer.shots=N the model is model.base as it is, prompted with
pipeline/language/few_shot.jinja and N worked examples (data/tokenize/train and data/flow/train or data/render/train).
Writes data/infer/<suite>: clip, sample (-1 greedy, 0 … K-1), text, scene (canonical YAML), log_probability.
Parameters: seed, clip, flow.picture, model, infer. Run: python -m stages.infer SUITE
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.clips.schedule import Schedule
from pipeline.language.completion import read_completion
from pipeline.language.few_shot import TEMPLATE, instructions
from pipeline.model.base import Base, load_base
from pipeline.model.generate import Sampling, batches, generate
from pipeline.model.patches import resize_frames
from pipeline.model.prompt import Prompt, bare_prompt, few_shot_prompt
from pipeline.model.walker import Tries
from pipeline.scene.text import write_scene
from pipeline.shards.dataset import Clip
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from pipeline.vision.flow.flow_picture import scaled_max_px
from stages.graph.answering_model import answering_model
from stages.graph.clip_pictures import picture_stage, pictures
from stages.graph.examples import Example, choose_examples, example_clip
from stages.graph.params import InferSettings, ModelSettings
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "sample": pa.int32(),
        "text": pa.string(),
        "scene": pa.string(),
        "log_probability": pa.float64(),
    }
)


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        seed: Of the sampled answers.
        schedule: The frames of a clip.
        model: The section `model`, with the checkpoint that answers as `base`.
        picture: How flow is shown: channels or wheel.
        settings: The section `infer`.
        examples: The worked examples of the prompt.
    """

    seed: int
    schedule: Schedule
    model: ModelSettings
    picture: str
    settings: InferSettings
    examples: tuple[Example, ...]


@lru_cache(maxsize=1)
def model(folder: str, width: int, height: int, frames: int, dtype: str) -> tuple[Base, Tries]:
    base = load_base(folder, width, height, frames, dtype)
    return base, Tries(base.codec)


def shown(clip: Clip, base: Base, p: Parameters) -> np.ndarray:
    return resize_frames(pictures(clip, p.model.input, p.schedule), base.layout.width, base.layout.height)


def prompt(base: Base, p: Parameters) -> Prompt:
    if not p.examples:
        return bare_prompt(base)
    schedule, width, reasoning = p.schedule, base.layout.width, p.model.reasoning
    kind = "rgb" if p.model.input == "rgb" else p.picture
    text = instructions(kind, reasoning, base.layout.frames, schedule.seconds, schedule.fps,
                        scaled_max_px(width, 1 / schedule.fps), width)  # fmt: skip
    videos = np.stack([shown(example_clip(e, p.model.input), base, p) for e in p.examples])
    return few_shot_prompt(base, text, videos, [e.completion for e in p.examples], reasoning, schedule.seconds)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    (source,) = inputs
    p, m, own = parameters, parameters.model, parameters.settings
    base, tries = model(m.base, m.width, m.height, p.schedule.model_frames, m.dtype)
    asked = prompt(base, p)
    how: dict[str, Any] = {"reasoning": m.reasoning, "seconds": p.schedule.seconds, "numbers": own.numbers,
                           "middle": own.middle}  # fmt: skip
    greedy, sampled = Sampling(**how), Sampling(own.samples, own.temperature, own.top_p, **how)
    rows: list[dict[str, Any]] = []
    for sampling in (greedy, sampled):
        for part in batches(len(shard), sampling.samples, own.decode_batch_size):
            clips = [shard.start + i for i in part]
            videos = np.stack([shown(Clip(c, source), base, p) for c in clips])
            seeds = [zlib.crc32(f"{p.seed} {shard.suite} {c}".encode()) for c in clips]
            for clip, answers in zip(clips, generate(base, videos, sampling, seeds, tries, asked), strict=True):
                for k, answer in enumerate(answers):
                    scene = write_scene(read_completion(answer.text).scene)
                    rows.append({"clip": clip, "sample": k if sampling is sampled else -1, "text": answer.text,
                                 "scene": scene, "log_probability": answer.log_probability})  # fmt: skip
    rows.sort(key=lambda row: (row["clip"], row["sample"]))
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes={"answers": len(rows), "parsed": len(rows)})


def main(suite: str) -> None:
    params = load("infer", suite)
    m, own = params.model, params.infer
    examples = choose_examples(own.shots, suite, m.input)
    checkpoint = Path(m.base) if examples else answering_model().folder
    files = {"model": checkpoint} if checkpoint.is_dir() or not examples else {}
    parameters = Parameters(
        seed=params.seed,
        schedule=params.clip.schedule,
        model=m.model_copy(update={"base": str(checkpoint)}),
        picture=params.flow.picture,
        settings=own,
        examples=tuple(examples),
    )
    run_shards("infer", suite, compute, parameters, [picture_stage(m.input)], files={**files, "prompt": TEMPLATE},
               versions=["torch", "transformers"])  # fmt: skip


if __name__ == "__main__":
    run(main)
