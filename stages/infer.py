"""Completions of clips: one greedy and K sampled, under the grammar, so that every answer parses.

Reads the model that answers (data/finetune/model, or with prefer.enabled data/prefer/model) and data/flow/<suite> (or
data/render/<suite> with model.input=rgb). With infer.shots=N the model is model.base as it is, prompted with
pipeline/language/few_shot.jinja and N worked examples (data/tokenize/train and data/flow/train or data/render/train).
Writes data/infer/<suite>: clip, sample (-1 greedy, 0 … K-1), text, scene (canonical YAML), log_probability.
Parameters: seed, clip, flow.picture, model, infer. Run: python -m stages.infer SUITE
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pipeline.model.prompt import Prompt, bare_prompt, few_shot_prompt
from pipeline.model.walker import Tries

from pipeline.language.completion import read_completion
from pipeline.language.few_shot import TEMPLATE, instructions
from pipeline.model.base import Base, load_base
from pipeline.model.generate import Sampling, batches, generate
from pipeline.model.patches import resize_frames
from pipeline.scene.text import write_scene
from pipeline.shards.dataset import Clip
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from pipeline.vision.flow_picture import scaled_max_px
from stages.graph.answering_model import answering_model
from stages.graph.clip_pictures import picture_stage, pictures
from stages.graph.examples import Example, choose_examples, example_clip
from stages.graph.main import run
from stages.graph.params import load
from stages.graph.run_shards import run_shards

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "sample": pa.int32(),
        "text": pa.string(),
        "scene": pa.string(),
        "log_probability": pa.float64(),
    }
)


@lru_cache(maxsize=1)
def model(folder: str, width: int, height: int, frames: int, dtype: str) -> tuple[Base, Tries]:
    base = load_base(folder, width, height, frames, dtype)
    return base, Tries(base.codec)


def shown(clip: Clip, base: Base, p: Mapping[str, Any]) -> np.ndarray:
    return resize_frames(pictures(clip, p["input"], p["clip"]), base.layout.width, base.layout.height)


def prompt(base: Base, p: Mapping[str, Any]) -> Prompt:
    if not p["examples"]:
        return bare_prompt(base)
    examples = [Example(**row) for row in p["examples"]]
    clip, width = p["clip"], base.layout.width
    kind = "rgb" if p["input"] == "rgb" else p["picture"]
    text = instructions(kind, p["reasoning"], base.layout.frames, clip["seconds"], clip["fps"],
                        scaled_max_px(width, 1 / clip["fps"]), width)  # fmt: skip
    videos = np.stack([shown(example_clip(e, p["input"]), base, p) for e in examples])
    return few_shot_prompt(base, text, videos, [e.completion for e in examples], p["reasoning"], clip["seconds"])


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    (source,) = inputs
    base, tries = model(p["model"], p["width"], p["height"], p["clip"]["model_frames"], p["dtype"])
    asked = prompt(base, p)
    how = {"reasoning": p["reasoning"], "seconds": p["clip"]["seconds"], "numbers": p["numbers"], "middle": p["middle"]}
    greedy, sampled = Sampling(**how), Sampling(p["samples"], p["temperature"], p["top_p"], **how)
    rows: list[dict[str, Any]] = []
    for sampling in (greedy, sampled):
        for part in batches(len(shard), sampling.samples, p["batch_size"]):
            clips = [shard.start + i for i in part]
            videos = np.stack([shown(Clip(c, source), base, p) for c in clips])
            seeds = [zlib.crc32(f"{p['seed']} {shard.suite} {c}".encode()) for c in clips]
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
    parameters = {"seed": params.seed, "clip": params.clip.model_dump(), "model": str(checkpoint),
                  "input": m.input, "reasoning": m.reasoning, "dtype": m.dtype, "width": m.width, "height": m.height,
                  "picture": params.flow.picture, "samples": own.samples, "temperature": own.temperature,
                  "top_p": own.top_p, "numbers": own.numbers, "middle": own.middle, "batch_size": own.batch_size,
                  "examples": [asdict(e) for e in examples]}  # fmt: skip
    run_shards("infer", suite, compute, parameters, [picture_stage(m.input)], files={**files, "prompt": TEMPLATE},
               versions=["torch", "transformers"])  # fmt: skip


if __name__ == "__main__":
    run(main)
