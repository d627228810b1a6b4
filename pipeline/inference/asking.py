"""What the model says of a clip: the flow is measured as it was trained, it is loaded, and it is asked.

Loading the model and measuring the flow need no masks, so that both run in threads of their own while bodies are looked
for: importing transformers alone takes seconds. What is heavy is imported by the functions that need it.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.errors import ModelError, ParamsError, naming
from pipeline.model.model_input import ModelInput, missing_input, read_input
from pipeline.scene.scene import Scene
from pipeline.vision.recordings.letterbox import Letterbox, letterbox_for, of_area
from pipeline.vision.recordings.mask_file import sized
from pipeline.vision.rendering.camera import focal_px, fov_deg

if TYPE_CHECKING:
    from pipeline.bodies.user_clip import UserClip
    from pipeline.clips.schedule import Schedule
    from pipeline.inference.answers import Answer
    from pipeline.inference.measured_clip import MeasuredClip
    from pipeline.model.base import Base
    from pipeline.model.sampling import Sampling
    from pipeline.model.words_model import WordsModel
    from pipeline.vision.recordings.video import Clip

ROOT = Path(__file__).resolve().parents[2]
FLOW_SIZE, FLOW_ITERATIONS = (240, 160), 4  # of flow for a model that is not shown any, as in params.yaml
DECODE_BATCH_SIZE = 64  # sequences decoded at a time, as in params.yaml


@dataclass(frozen=True)
class Question:
    """How the model is asked.

    Attributes:
        samples: Answers beside the greedy one.
        temperature: Of sampling words.
        top_p: Share of the distribution that words are sampled from.
        middle: Share of a number's distribution from which samples are drawn.
        seed: Of sampling.
    """

    samples: int
    temperature: float
    top_p: float
    middle: float
    seed: int


@dataclass(frozen=True)
class LoadingModel:
    """A model that is being loaded.

    Attributes:
        name: As it was given.
        input: How its input is made; None where that is not known before it is there.
        base: The model.
    """

    name: str
    input: ModelInput | None
    base: Future[Base | WordsModel]

    @property
    def shown(self) -> ModelInput:
        """How its input is made. Raises ModelError."""
        return self.input.asked if self.input else input_of(self.base.result())


def ask_model(loading: LoadingModel, clip: MeasuredClip, question: Question) -> tuple[list[Answer], Sampling]:
    """Wait for the model and ask it.

    Args:
        loading: The model.
        clip: Frames, masks, flow and shape prior.
        question: How it is asked.

    Returns:
        The greedy answer, then the samples; and how they were drawn.

    Raises:
        ModelError: For a model that cannot be loaded.
    """
    from pipeline.clips.replay import HEIGHT, WIDTH
    from pipeline.inference.answers import answer_seed, ask
    from pipeline.inference.model_pictures import shown_clip
    from pipeline.model.sampling import Sampling

    base = loading.base.result()
    shown, q = input_of(base), question
    taken, schedule = clip.taken, clip.schedule
    sampling = Sampling(q.samples, q.temperature, q.top_p, shown.reasoning is True, schedule.seconds, middle=q.middle)
    first = schedule.pairs[:, 0]
    box = letterbox_for(taken.clip.letterbox.size, (WIDTH, HEIGHT))
    frames = np.stack([box.apply(f) for f in taken.clip.frames[first]])
    flow = np.stack([box.apply(f) for f in clip.flow]) * np.float32(box.scale)
    seen = shown_clip(
        base, shown, flow, frames, sized(taken.masks[first], box.size), 1 / schedule.fps, clip.shape_prior
    )
    (answers,) = ask(base, lambda _: seen, [answer_seed(q.seed, 0)], sampling, DECODE_BATCH_SIZE)
    return [replace(a, seen=source_camera(a.scene, box)) for a in answers], sampling


def source_camera(scene: Scene, letterbox: Letterbox) -> Scene:
    """The scene with the camera of a letterbox's source, where its own sees what the letterbox makes of that."""
    assert scene.camera is not None
    focal = focal_px(scene.camera.fov, letterbox.size[1]) / letterbox.scale
    return replace(scene, camera=replace(scene.camera, fov=fov_deg(focal, letterbox.source[1])))


def raw_flow(clip: Clip, schedule: Schedule, shown: ModelInput, source: str, raft: Path) -> np.ndarray:
    """The flow (P, H, W, 2) of the pairs of frames that the model sees, as it is measured.

    Args:
        clip: The frames.
        schedule: Which pairs of them.
        shown: How the model's input is made.
        source: "raft" or "dis".
        raft: Weights of RAFT.
    """
    from pipeline.vision.flow.dis import DIS
    from pipeline.vision.flow.measured_flow import measured_flow
    from pipeline.vision.flow.raft import load_raft

    return measured_flow(
        load_raft(raft) if source == "raft" else DIS("medium"),
        clip.frames,
        clip.source_times,
        schedule.pairs,
        1 / schedule.fps,
        shown.flow_iterations or FLOW_ITERATIONS,
        estimation_size(clip, shown),
    )


def shown_flow(raw: np.ndarray, taken: UserClip, schedule: Schedule, shown: ModelInput) -> np.ndarray:
    """The flow (P, H, W, 2) with what cannot be measured filled in by the masks, as the stage `flow` does.

    Args:
        raw: As `raw_flow` gives it.
        taken: Frames and masks.
        schedule: Which pairs of frames the model sees.
        shown: How the model's input is made.
    """
    from pipeline.vision.flow.supported_flow import supported_flow

    clip, size = taken.clip, estimation_size(taken.clip, shown)
    times, interval = clip.source_times, 1 / schedule.fps
    return supported_flow(raw, clip.frames, taken.masks, times, schedule.pairs, interval=interval, size=size).flow


def estimation_size(clip: Clip, shown: ModelInput) -> tuple[int, int]:
    """px, width and height, at which flow of a clip is estimated: of the area that the model learned from."""
    width, height = shown.flow_size or FLOW_SIZE
    return of_area(clip.letterbox.size, width * height)


def load_in_background(name: str, parameter: str = "model") -> LoadingModel:
    """`load_model` in a thread of its own."""
    thread = ThreadPoolExecutor(1, "load_model")
    base = thread.submit(load_model, name, parameter)
    thread.shutdown(wait=False)
    try:
        return LoadingModel(name, read_input(str(shipped(name))), base)
    except ModelError:  # which `base` will raise, too
        return LoadingModel(name, None, base)


def loaded(base: Base | WordsModel) -> LoadingModel:
    """A model that is there already."""
    there: Future[Base | WordsModel] = Future()
    there.set_result(base)
    return LoadingModel(base.name, input_of(base), there)


def load_model(name: str, parameter: str = "model") -> Base | WordsModel:
    """The model in a folder, or of that name in the local hub cache.

    Args:
        name: Also that of a folder which ships with this project.
        parameter: What the user calls it, for the message of an error.

    Raises:
        ModelError: Where it cannot be loaded, or has not recorded how its input is made.
    """
    from pipeline.clips.schedule import Schedule
    from pipeline.model.answering import load_answering

    with naming(parameter):
        base = load_answering(str(shipped(name)), frames=Schedule().model_frames)
        input_of(base)
        return base


def input_of(base: Base | WordsModel) -> ModelInput:
    """How the model's input is made. Raises ModelError where the checkpoint has not recorded that."""
    if base.input is None:
        raise missing_input(base.name)
    return base.input.asked


def flow_source(shown: ModelInput, flow: str | None, model: str) -> str:
    """How flow is measured: as asked for, else as in training. model: its name, for the message of an error."""
    if flow is not None and flow not in ("raft", "dis"):
        raise ParamsError(f"flow: {flow!r}; valid: raft, dis")
    if flow is not None and shown.input != "rgb":
        shown.check("flow_source", flow, "flow", model)
    trained = shown.flow_source if shown.flow_source in ("raft", "dis") else "raft"
    return flow or trained


def shipped(path: str | Path) -> Path:
    """A path as given; where it is not there from here, the same path in this project, if it is there."""
    place = Path(path)
    return ROOT / place if not place.exists() and not place.is_absolute() and (ROOT / place).exists() else place
