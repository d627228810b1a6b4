"""The sections of params.yaml: their keys, and which values are valid.

`Params` is the whole file. Which of its keys a stage reads is in `stage_params.READS`.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from pipeline.clips.schedule import Schedule
from pipeline.model.model_input import CROP_SIDE
from pipeline.scene.scene import BASIC_SHAPES
from stages.graph.params_file import Section

PARAMS_FILE = Path("params.yaml")

MOST_CLIPS, MOST_PIXELS, MOST = 10**9, 8192, 1e6


def _in_order(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise PydanticCustomError("range", "the low end is above the high end; valid: [low, high]")
    return value


def _some_weight(value: dict[Any, float]) -> dict[Any, float]:
    if not sum(value.values()) > 0:
        raise PydanticCustomError("weights", "at least one weight must be greater than 0")
    return value


def _composition(value: str) -> str:
    shapes = value.split("+")
    unknown = [shape for shape in shapes if shape not in BASIC_SHAPES]
    if unknown:
        valid = {"shape": unknown[0], "valid": ", ".join(BASIC_SHAPES)}
        raise PydanticCustomError("composition", "unknown shape `{shape}`; valid: {valid}, joined by +", valid)
    if shapes != sorted(shapes):
        raise PydanticCustomError(
            "composition", "the shapes must be sorted: {valid}", {"valid": "+".join(sorted(shapes))}
        )
    return value


Seed = Annotated[int, Field(ge=0, lt=2**63)]
Count = Annotated[int, Field(ge=1, le=MOST_CLIPS)]
Clips = Annotated[int, Field(ge=0, le=MOST_CLIPS)]
Side = Annotated[int, Field(le=MOST_PIXELS)]
Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0, le=MOST)]
NonNegative = Annotated[float, Field(ge=0, le=MOST)]
Range = Annotated[tuple[float, float], AfterValidator(_in_order)]
PositiveRange = Annotated[tuple[Positive, Positive], AfterValidator(_in_order)]
NonNegativeRange = Annotated[tuple[NonNegative, NonNegative], AfterValidator(_in_order)]
Weights = Annotated[dict[str, NonNegative], AfterValidator(_some_weight)]
Composition = Annotated[str, AfterValidator(_composition)]


class SuiteSettings(Section):
    """A set of sampled clips."""

    clips: Clips
    objects: Annotated[dict[Annotated[int, Field(ge=1, le=6)], NonNegative], AfterValidator(_some_weight)]
    only: list[Composition]
    without: list[Composition]


class ViewsSuiteSettings(Section):
    """Sampled clips whose kinds of views take turns."""

    clips: Clips


class RealSuiteSettings(Section):
    """The user's own clips."""

    path: str | None
    start: NonNegative
    seconds: Positive
    fps: Positive | None


class SuitesSettings(Section):
    train: SuiteSettings
    val: SuiteSettings
    id: SuiteSettings
    held_out: SuiteSettings
    more: SuiteSettings
    views: ViewsSuiteSettings
    real: RealSuiteSettings


class FilterSettings(Section):
    overlap_m: NonNegative
    area_px: NonNegative
    visible_px: Positive
    out_of_view: Annotated[int, Field(ge=0)]
    tries: Count


class DistributionSettings(Section):
    camera_height: PositiveRange
    camera_distance: Positive
    camera_target_height: Range
    camera_fov: PositiveRange
    gravity: NonNegativeRange
    sphere_radius: PositiveRange
    cylinder_radius: PositiveRange
    cylinder_height: PositiveRange
    box_side: PositiveRange
    mass: PositiveRange
    sliding_friction: NonNegativeRange
    rolling_friction: NonNegativeRange
    damping: PositiveRange
    x: Range
    y: Range
    airborne: Share
    drop_height: NonNegativeRange
    speed: NonNegativeRange
    toward: Share
    rolling: Share
    spin: NonNegativeRange
    lying: Share


class SampleSettings(Section):
    shard_size: Count
    filters: FilterSettings
    distribution: DistributionSettings


class ClipSettings(Section):
    seconds: Positive
    fps: Count
    model_frames: Annotated[int, Field(ge=2, multiple_of=2)]

    @model_validator(mode="after")
    def _pairs_fit(self) -> "ClipSettings":
        frames = round(self.seconds * self.fps)
        if self.model_frames >= frames:
            raise PydanticCustomError("pairs", f"`model_frames` must be less than the {frames} frames of seconds x fps")
        return self

    @property
    def schedule(self) -> Schedule:
        return Schedule(**self.model_dump())


class RenderSettings(Section):
    width: Annotated[Side, Field(ge=32)]
    height: Annotated[Side, Field(ge=32)]
    backend: Literal["auto", "mujoco", "raycast"]
    shadows: bool
    textures: Weights
    floors: Weights
    backdrops: Weights
    lights: Count
    metal: Share
    sensor_noise: Share
    blur: NonNegative


class FlowSettings(Section):
    source: Literal["raft", "exact", "dis"]
    train_source: Literal["raft", "exact", "dis"]
    raft: str
    width: Annotated[Side, Field(ge=64)]
    height: Annotated[Side, Field(ge=64)]
    iterations: Count
    confidence: bool
    noise: NonNegative
    picture: Literal["channels", "wheel"]


class EventsSettings(Section):
    impact_speed: NonNegative
    separation: Positive
    slip_speed: Positive
    moving_speed: Positive
    duration: Positive
    most: Annotated[int, Field(ge=0, le=24)]  # MAX_EVENTS of the grammar


class ModelSettings(Section):
    base: str
    input: Literal["flow", "rgb"]
    sees: Literal["bodies", "frame"]
    reasoning: bool
    dtype: Literal["float32", "bfloat16"]
    width: Count
    height: Count

    @property
    def size(self) -> tuple[int, int]:
        """px, width and height of the pictures for a model with a tokenizer."""
        return (CROP_SIDE, CROP_SIDE) if self.sees == "bodies" else (self.width, self.height)


class FinetuneSettings(Section):
    steps: Count | None
    epochs: Positive
    batch_size: Count
    learning_rate: Positive
    lora_rank: Annotated[int, Field(ge=0)]
    checkpoint_steps: Count


class PreferSettings(Section):
    enabled: bool
    suite: Literal["id", "held_out", "more", "real"]
    clips: Count
    samples: Annotated[int, Field(ge=2)]
    temperature: Positive
    top_p: Annotated[float, Field(gt=0, le=1)]
    decode_batch_size: Count
    epe_weight: NonNegative
    margin: NonNegative
    pairs: Count
    beta: Positive
    steps: Count
    batch_size: Count
    learning_rate: Positive
    lora_rank: Annotated[int, Field(ge=0)]
    checkpoint_steps: Count


class RegressSettings(Section):
    enabled: bool
    width: Annotated[Side, Field(ge=16, multiple_of=16)]
    height: Annotated[Side, Field(ge=16, multiple_of=16)]
    hidden: Count
    layers: Count
    heads: Count
    steps: Count | None
    epochs: Positive
    batch_size: Count
    learning_rate: Positive
    checkpoint_steps: Count

    @model_validator(mode="after")
    def _heads_share_the_width(self) -> "RegressSettings":
        if self.hidden % self.heads:
            raise PydanticCustomError("heads", f"`hidden` must be a multiple of the {self.heads} `heads`")
        return self


class InferSettings(Section):
    shots: Annotated[int, Field(ge=0)]
    samples: Count
    temperature: Positive
    top_p: Annotated[float, Field(gt=0, le=1)]
    numbers: Literal["quantiles", "tokens"]
    middle: Annotated[float, Field(gt=0, le=1)]
    decode_batch_size: Count


class SearchSettings(Section):
    width: Annotated[Side, Field(ge=24)]
    height: Annotated[Side, Field(ge=16)]
    starts: Count

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.width, self.height


class CmaesSettings(Section):
    population: Annotated[int, Field(ge=4)]
    iterations: Annotated[int, Field(ge=0)]
    sigma: Positive


class FitSettings(Section):
    simulations: Annotated[int, Field(ge=200)]


class PredictSettings(Section):
    seconds: Positive
    simulations: Count


class TracksSettings(Section):
    simulations: Annotated[int, Field(ge=200)]


class ScoreSettings(Section):
    bootstrap: Count
    gallery: Annotated[int, Field(ge=0)]


class HideSettings(Section):
    worlds: Count
    effects: Annotated[list[str], Field(min_length=1)]
    strength: Positive
    noise: Positive
    clips: Count


class FilmedExperiment(Section):
    scenario: Literal["bounce", "roll", "puck"]
    effect: str


class HideFilmedSettings(Section):
    worlds: Count
    experiments: Annotated[list[FilmedExperiment], Field(min_length=1)]
    strength: Positive
    clips: Count


class DiscoverSettings(Section):
    held_out: Annotated[float, Field(ge=0, lt=1)]
    effects: str


class TrainingSettings(Section):
    processes: Annotated[int, Field(ge=1, le=1024)]


class ExecutorSettings(Section):
    name: Literal["local", "ray"]
    workers: Count | None  # null: one a core


class Params(Section):
    seed: Seed
    suites: SuitesSettings
    sample: SampleSettings
    clip: ClipSettings
    render: RenderSettings
    flow: FlowSettings
    events: EventsSettings
    model: ModelSettings
    finetune: FinetuneSettings
    prefer: PreferSettings
    regress: RegressSettings
    infer: InferSettings
    search: SearchSettings
    cmaes: CmaesSettings
    fit: FitSettings
    predict: PredictSettings
    tracks: TracksSettings
    score: ScoreSettings
    hide: HideSettings
    hide_filmed: HideFilmedSettings
    discover: DiscoverSettings
    training: TrainingSettings
    executor: ExecutorSettings
