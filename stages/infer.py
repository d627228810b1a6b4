"""Completions of clips: one greedy and K sampled, under the grammar, so that every answer parses.

Reads the model that answers (data/finetune/model, or with prefer.enabled data/prefer/model) and data/flow/<suite> (or
data/render/<suite> with model.input=rgb). Writes data/infer/<suite>: clip, sample (-1 greedy, 0 … K-1), text, scene
(canonical YAML), log_probability.
Parameters: seed, clip, model.input, model.reasoning, model.dtype, infer. Run: python -m stages.infer SUITE
"""

import zlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.language.completion import read_completion
from pipeline.model.base import Base, load_base
from pipeline.model.generate import Sampling, batches, generate
from pipeline.model.patches import resize_frames
from pipeline.model.walker import Tries
from pipeline.scene.text import write_scene
from pipeline.shards.dataset import Clip
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.answering_model import answering_model
from stages.clip_pictures import picture_stage, pictures
from stages.main import run
from stages.params import load
from stages.run_shards import run_shards

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
def model(folder: str, frames: int, dtype: str) -> tuple[Base, Tries]:
    base = load_base(folder, frames=frames, dtype=dtype)
    return base, Tries(base.codec)


def compute(shard: Shard, inputs: Sequence[OpenShard], p: Mapping[str, Any]) -> ShardResult:
    (source,) = inputs
    base, tries = model(p["model"], p["clip"]["model_frames"], p["dtype"])
    greedy = Sampling(reasoning=p["reasoning"], seconds=p["clip"]["seconds"])
    sampled = Sampling(p["samples"], p["temperature"], p["top_p"], p["reasoning"], p["clip"]["seconds"])
    rows: list[dict[str, Any]] = []
    for sampling in (greedy, sampled):
        for part in batches(len(shard), sampling.samples, p["batch_size"]):
            clips = [shard.start + i for i in part]
            shown = np.stack([resize_frames(pictures(Clip(c, source), p["input"], p["clip"]), base.layout.width,
                                            base.layout.height) for c in clips])  # fmt: skip
            seeds = [zlib.crc32(f"{p['seed']} {shard.suite} {c}".encode()) for c in clips]
            for clip, answers in zip(clips, generate(base, shown, sampling, seeds, tries), strict=True):
                for k, answer in enumerate(answers):
                    scene = write_scene(read_completion(answer.text).scene)
                    rows.append({"clip": clip, "sample": k if sampling is sampled else -1, "text": answer.text,
                                 "scene": scene, "log_probability": answer.log_probability})  # fmt: skip
    rows.sort(key=lambda row: (row["clip"], row["sample"]))
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes={"answers": len(rows), "parsed": len(rows)})


def main(suite: str) -> None:
    params = load("infer", suite)
    m, checkpoint = params.model, answering_model().folder
    parameters = {"seed": params.seed, "clip": params.clip.model_dump(), "input": m.input, "reasoning": m.reasoning,
                  "dtype": m.dtype, "model": str(checkpoint), **params.infer.model_dump()}  # fmt: skip
    run_shards("infer", suite, compute, parameters, [picture_stage(m.input)], files={"model": checkpoint},
               versions=["torch", "transformers"])  # fmt: skip


if __name__ == "__main__":
    run(main)
