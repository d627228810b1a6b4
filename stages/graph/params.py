"""The parameters: params.yaml, read and checked as a whole, and handed to a stage as far as it declares.

A section is a class below and a field of `Params`; the keys that a stage reads are its line in `READS`, which
must be those of its `params:` in dvc.yaml (tests/test_dvc_graph.py compares). `executor` is nobody's: how many
workers there are must not run anything again.
"""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from stages.graph.params_file import Section, read_params_file
from stages.graph.params_view import ParamsView

PARAMS_FILE = Path("params.yaml")

Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Range = tuple[float, float]
Weights = dict[str, NonNegative]


class Suite(Section):
    """A set of sampled clips."""

    clips: Annotated[int, Field(ge=0)]
    objects: dict[Annotated[int, Field(ge=1, le=6)], NonNegative]
    only: list[str]
    without: list[str]


class RealSuite(Section):
    """The user's own clips."""

    path: str | None
    start: NonNegative
    seconds: Positive
    fps: Positive | None


class Suites(Section):
    train: Suite
    val: Suite
    id: Suite
    held_out: Suite
    more: Suite
    real: RealSuite


class FilterSettings(Section):
    overlap_m: NonNegative
    area_px: NonNegative
    visible_px: Positive
    out_of_view: Annotated[int, Field(ge=0)]
    tries: Count


class DistributionSettings(Section):
    camera_height: Range
    camera_distance: Positive
    camera_target_height: Range
    camera_fov: Range
    gravity: Range
    sphere_radius: Range
    cylinder_radius: Range
    cylinder_height: Range
    box_side: Range
    mass: Range
    sliding_friction: Range
    rolling_friction: Range
    damping: Range
    x: Range
    y: Range
    airborne: Share
    drop_height: Range
    speed: Range
    toward: Share
    rolling: Share
    spin: Range
    lying: Share


class Sample(Section):
    shard_size: Count
    filters: FilterSettings
    distribution: DistributionSettings


class Clip(Section):
    seconds: Positive
    fps: Count
    model_frames: Annotated[int, Field(ge=2, multiple_of=2)]

    @model_validator(mode="after")
    def _pairs_fit(self) -> "Clip":
        frames = round(self.seconds * self.fps)
        if self.model_frames >= frames:
            raise PydanticCustomError("pairs", f"`model_frames` must be less than the {frames} frames of seconds x fps")
        return self


class Render(Section):
    width: Annotated[int, Field(ge=32)]
    height: Annotated[int, Field(ge=32)]
    backend: Literal["auto", "mujoco", "raycast"]
    shadows: bool
    textures: Weights
    floors: Weights
    backdrops: Weights
    lights: Count
    metal: Share
    sensor_noise: Share
    blur: NonNegative


class Flow(Section):
    source: Literal["raft", "exact", "dis"]
    train_source: Literal["raft", "exact", "dis"]
    raft: str
    width: Annotated[int, Field(ge=64)]
    height: Annotated[int, Field(ge=64)]
    iterations: Count
    noise: NonNegative
    picture: Literal["channels", "wheel"]


class Events(Section):
    impact_speed: NonNegative
    separation: Positive
    slip_speed: Positive
    moving_speed: Positive
    duration: Positive
    most: Annotated[int, Field(ge=0, le=24)]  # MAX_EVENTS of the grammar


class Model(Section):
    base: str
    input: Literal["flow", "rgb"]
    reasoning: bool
    dtype: Literal["float32", "bfloat16"]
    width: Count
    height: Count


class Finetune(Section):
    steps: Count | None
    epochs: Positive
    batch_size: Count
    learning_rate: Positive
    lora_rank: Annotated[int, Field(ge=0)]
    checkpoint_steps: Count


class Prefer(Section):
    enabled: bool
    suite: Literal["id", "held_out", "more", "real"]
    clips: Count
    samples: Annotated[int, Field(ge=2)]
    temperature: Positive
    top_p: Annotated[float, Field(gt=0, le=1)]
    decoded: Count
    epe_weight: NonNegative
    margin: NonNegative
    pairs: Count
    beta: Positive
    steps: Count
    batch_size: Count
    learning_rate: Positive
    lora_rank: Annotated[int, Field(ge=0)]
    checkpoint_steps: Count


class Regress(Section):
    enabled: bool
    width: Annotated[int, Field(ge=16, multiple_of=16)]
    height: Annotated[int, Field(ge=16, multiple_of=16)]
    hidden: Count
    layers: Count
    heads: Count
    steps: Count | None
    epochs: Positive
    batch_size: Count
    learning_rate: Positive
    checkpoint_steps: Count

    @model_validator(mode="after")
    def _heads_share_the_width(self) -> "Regress":
        if self.hidden % self.heads:
            raise PydanticCustomError("heads", f"`hidden` must be a multiple of the {self.heads} `heads`")
        return self


class Infer(Section):
    shots: Annotated[int, Field(ge=0)]
    samples: Count
    temperature: Positive
    top_p: Annotated[float, Field(gt=0, le=1)]
    numbers: Literal["quantiles", "tokens"]
    middle: Annotated[float, Field(gt=0, le=1)]
    batch_size: Count


class Search(Section):
    width: Annotated[int, Field(ge=24)]
    height: Annotated[int, Field(ge=16)]
    starts: Count


class Cmaes(Section):
    population: Annotated[int, Field(ge=4)]
    iterations: Annotated[int, Field(ge=0)]
    sigma: Positive


class Fit(Section):
    simulations: Annotated[int, Field(ge=200)]


class Predict(Section):
    seconds: Positive
    simulations: Count


class Score(Section):
    bootstrap: Count
    gallery: Annotated[int, Field(ge=0)]


class Hide(Section):
    worlds: Count
    effects: Annotated[list[str], Field(min_length=1)]
    strength: Positive
    noise: Positive
    clips: Count


class Discover(Section):
    held_out: Annotated[float, Field(ge=0, lt=1)]
    effects: str


class ExecutorSettings(Section):
    name: Literal["local", "slice", "ray"]
    workers: Count | None  # null: one a core


class Params(Section):
    seed: int
    suites: Suites
    sample: Sample
    clip: Clip
    render: Render
    flow: Flow
    events: Events
    model: Model
    finetune: Finetune
    prefer: Prefer
    regress: Regress
    infer: Infer
    search: Search
    cmaes: Cmaes
    fit: Fit
    predict: Predict
    score: Score
    hide: Hide
    discover: Discover
    executor: ExecutorSettings


READS: dict[str, tuple[str, ...]] = {
    "sample": ("seed", "sample", "clip", "suites.{suite}"),
    "compile": (),
    "simulate": ("clip",),
    "render": ("seed", "clip", "render", "model.input", "flow.train_source"),
    "import_clips": ("clip", "suites.real", "sample.shard_size"),
    "flow": ("seed", "clip", "flow"),
    "events": ("clip", "events", "sample.filters.visible_px"),
    "tokenize": ("clip", "model.base", "model.reasoning", "model.width", "model.height"),
    "finetune": ("seed", "clip", "model", "finetune", "infer.shots"),
    "prefer": (
        "seed",
        "clip",
        "model.input",
        "model.reasoning",
        "model.dtype",
        "search.width",
        "search.height",
        "prefer",
        "infer.shots",
    ),
    "regress": ("seed", "clip", "model.input", "sample.distribution", "regress"),
    "infer": ("seed", "clip", "flow.picture", "model", "infer"),
    "best_of_k": ("clip", "search"),
    "cmaes": ("seed", "clip", "search", "cmaes"),
    "fit": ("seed", "clip", "search", "fit"),
    "predict": ("seed", "clip", "search.width", "search.height", "predict"),
    "hide": ("seed", "hide"),
    "discover": ("seed", "discover"),
    "score": ("seed", "clip", "score", "model", "flow.source", "infer.shots", "regress.enabled"),
}
"""Stage -> the keys it reads, as narrow as can be; `{suite}` is the suite that the stage runs for."""


def declared_keys(stage: str, suite: str | None = None) -> tuple[str, ...]:
    """The keys that a stage reads, for a suite where it runs for one."""
    return tuple(key.format(suite=suite) for key in READS[stage])


def load(stage: str, suite: str | None = None, path: Path = PARAMS_FILE) -> Params:
    """The parameters of a stage: what it has not declared is not there.

    Raises ParamsError, naming the key, for an unknown, missing or impossible parameter anywhere in the file.
    """
    params = read_params_file(path, Params)
    return ParamsView.of(params, declared_keys(stage, suite), stage, path)  # type: ignore[return-value]


def load_executor(path: Path = PARAMS_FILE) -> ExecutorSettings:
    """Who computes, and with how many workers; declared by no stage."""
    return read_params_file(path, Params).executor
