"""Completions of clips: one greedy and K sampled, under the grammar, so that every answer parses.

Reads the model that answers (data/finetune/model, or with prefer.enabled data/prefer/model) and data/flow/<suite> (with
model.input=rgb data/render/<suite>, for the words model both). With infer.shots=N the model is model.base as it is,
prompted with pipeline/model/language/few_shot.jinja and N worked examples (data/tokenize/train and data/flow/train or
data/render/train).
Writes data/infer/<suite>: clip, sample (-1 greedy, 0 … K-1), text, scene (canonical YAML), log_probability.
Parameters: seed, clip, flow (but noise and train_source), model, infer. Run: python -m stages.infer SUITE
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError, naming
from pipeline.model.language.few_shot import TEMPLATE, instructions
from pipeline.model.model_input import ModelInput, is_words
from pipeline.scene.text import write_scene
from pipeline.shards.dataset import Clip
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from pipeline.vision.flow.flow_picture import scaled_max_px
from stages.graph.answering_model import answering_model
from stages.graph.clip_pictures import check_input, pictures
from stages.graph.examples import Example, choose_examples, example_clip
from stages.graph.params import InferSettings, ModelSettings
from stages.graph.run import run, run_shards
from stages.graph.shown_clip import shown_stages, shown_to
from stages.graph.stage_params import load

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.generate import Prompt
    from pipeline.model.words_model import WordsModel

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
def model(folder: str, width: int, height: int, frames: int, dtype: str) -> "Base | WordsModel":
    # imported here, as below: it takes seconds, and mostly the shards are in the store
    from pipeline.model.answering import load_answering

    with naming("model.base"):
        return load_answering(folder, width, height, frames, dtype)


def prompt(base: "Base | WordsModel", p: Parameters) -> "Prompt | None":
    from pipeline.model.generate import few_shot_prompt
    from pipeline.model.patches import fit_layout
    from pipeline.model.words_model import WordsModel

    if isinstance(base, WordsModel) or not p.examples:
        return None
    schedule, width, reasoning = p.schedule, base.layout.width, p.model.reasoning
    kind = "rgb" if p.model.input == "rgb" else p.picture
    text = instructions(
        kind,
        reasoning,
        base.layout.frames,
        schedule.seconds,
        schedule.fps,
        scaled_max_px(width, 1 / schedule.fps),
        width,
    )
    shown_examples = [pictures(example_clip(e, p.model.input), p.model.input, schedule) for e in p.examples]
    videos = np.stack([fit_layout(one, base.layout) for one in shown_examples])
    return few_shot_prompt(base, text, videos, [e.completion for e in p.examples], reasoning, schedule.seconds)


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    from pipeline.inference.answers import answer_seed, ask
    from pipeline.model.sampling import Sampling

    p, m, own = parameters, parameters.model, parameters.settings
    base = model(m.base, *m.size, p.schedule.model_frames, m.dtype)
    sampling = Sampling(
        samples=own.samples,
        temperature=own.temperature,
        top_p=own.top_p,
        reasoning=m.reasoning,
        seconds=p.schedule.seconds,
        numbers=own.numbers,
        middle=own.middle,
    )
    clips = list(shard.clips)
    seeds = [answer_seed(p.seed, shard.suite, c) for c in clips]
    answers = ask(
        base,
        lambda i: shown_to(base, [Clip(clips[i], s) for s in inputs], m.input, m.sees, p.schedule),
        seeds,
        sampling,
        own.decode_batch_size,
        prompt(base, p),
    )
    rows = [
        {
            "clip": clip,
            "sample": a.sample,
            "text": a.text,
            "scene": write_scene(a.scene),
            "log_probability": a.log_probability,
        }
        for clip, each in zip(clips, answers, strict=True)
        for a in each
    ]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)}, notes={"answers": len(rows), "parsed": len(rows)})


def main(suite: str) -> None:
    params = load("infer", suite)
    m, own, f = params.model, params.infer, params.flow
    words = is_words(m.base)
    if own.shots and words:
        raise ParamsError(f"infer.shots: {own.shots}, but {m.base} takes no worked examples; valid: 0")
    if own.shots and m.sees == "bodies":
        raise ParamsError(f"infer.shots: {own.shots} with model.sees: bodies; valid: model.sees: frame, or 0 shots")
    examples = choose_examples(own.shots, suite, m.input)
    checkpoint = Path(m.base) if examples else answering_model().folder
    picture = None if words else f.picture
    made = ModelInput.of(m.input, picture, f.source, (f.width, f.height), f.iterations, m.reasoning, m.sees)
    check_input(str(checkpoint), made, required=not examples)
    files = {"model": checkpoint} if checkpoint.is_dir() or not examples else {}
    parameters = Parameters(
        seed=params.seed,
        schedule=params.clip.schedule,
        model=m.model_copy(update={"base": str(checkpoint)}),
        picture=f.picture,
        settings=own,
        examples=tuple(examples),
    )
    run_shards(
        "infer",
        suite,
        compute,
        parameters,
        shown_stages(m.input, m.sees, words),
        files={**files, "prompt": TEMPLATE},
        versions=["torch", "transformers"],
    )


if __name__ == "__main__":
    run(main)
