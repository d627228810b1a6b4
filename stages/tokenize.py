"""Prompts, <think> and <answer> as token ids of the base model's own tokenizer.

Reads data/sample/<suite>, data/events/<suite>, model.base's tokenizer. Writes data/tokenize/<suite>: clip, completion
(text), ids, prompt_length, free (the model's to choose), numeric; the words model has no tokens of text.
Parameters: clip, model.base, model.reasoning, model.width, model.height. Run: python -m stages.tokenize SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa

from pipeline.clips.events import event_of_row
from pipeline.errors import naming
from pipeline.model.language.completion import write_completion
from pipeline.model.model_input import is_words
from pipeline.scene.text import read_scene
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load

if TYPE_CHECKING:
    from pipeline.model.language.codec import Codec

SCHEMA = pa.schema(
    {
        "clip": pa.int64(),
        "completion": pa.string(),
        "ids": pa.list_(pa.int32()),
        "prompt_length": pa.int32(),
        "free": pa.list_(pa.bool_()),
        "numeric": pa.list_(pa.bool_()),
    }
)


@dataclass(frozen=True)
class Parameters:
    """What `compute` needs.

    Attributes:
        base: The base model: a folder, or a hub name.
        reasoning: Whether <think> precedes <answer>.
        width: Of the model's pictures, px, where the base has no layout of its own; so `height`.
        frames: Of a clip that the model sees.
        seconds: Of a clip.
    """

    base: str
    reasoning: bool
    width: int
    height: int
    frames: int
    seconds: float


@lru_cache(maxsize=1)
def codec(base: str, width: int, height: int, frames: int) -> "Codec | None":
    # imported here, as below: it takes seconds, and mostly the shards are in the store
    from pipeline.model.checkpoint import load_tokenizer, read_layout
    from pipeline.model.language.codec import Codec

    if is_words(base):
        return None
    with naming("model.base"):
        return Codec(load_tokenizer(base), read_layout(base, width, height, frames).tokens)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    from pipeline.model.language.codec import NO_TOKENS

    sample, happened = inputs
    writer = codec(parameters.base, parameters.width, parameters.height, parameters.frames)
    reasoning, seconds = parameters.reasoning, parameters.seconds
    rows = []
    for row in sample.table().to_pylist():
        events = [event_of_row(e) for e in happened.rows(row["clip"], "events")]
        completion = write_completion(read_scene(row["scene"]), events if reasoning else None, seconds)
        tokens = writer.encode(completion, reasoning, seconds) if writer else NO_TOKENS
        rows.append(
            {
                "clip": row["clip"],
                "completion": completion,
                "ids": tokens.ids.tolist(),
                "prompt_length": tokens.prompt_length,
                "free": tokens.free.tolist(),
                "numeric": tokens.numeric.tolist(),
            }
        )
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes={"tokens": sum(len(r["ids"]) for r in rows)})


def main(suite: str) -> None:
    params = load("tokenize", suite)
    m = params.model
    parameters = Parameters(
        base=m.base,
        reasoning=m.reasoning,
        width=m.width,
        height=m.height,
        frames=params.clip.model_frames,
        seconds=params.clip.seconds,
    )
    names = ("config.json", "tokenizer.json", "tokenizer_config.json", "clip_layout.json")
    files = {name: Path(m.base) / name for name in names if (Path(m.base) / name).is_file()}
    run_shards(
        "tokenize",
        suite,
        compute,
        parameters,
        ["sample", "events"],
        files=files,
        versions=["tokenizers", "transformers"],
    )


if __name__ == "__main__":
    run(main)
