"""`pipeline.infer`: from a clip to a scene.

The clip is measured (frames, masks, flow), the model is asked, its answers are replayed and ranked, the best of them
and a classical guess are refined by the search, and the best scene of all is the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.api.inference import Inference, Settings
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import UserClip
from pipeline.bodies.video_stretch import VideoStretch
from pipeline.errors import ParamsError
from pipeline.inference.asking import LoadingModel, Question, flow_source, load_in_background, loaded, shipped
from pipeline.inference.filmed_world import World
from pipeline.inference.find_scenes import SearchBudget, find_scenes
from pipeline.inference.measure_clip import FlowSource, measure_clip
from pipeline.inference.measured_clip import MeasuredClip
from pipeline.inference.progress import Progress
from pipeline.inference.scene_search import LEAST_SEARCH
from pipeline.model.sampling import Sampling
from pipeline.vision.recordings.corrections import Correction

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel


def infer(
    clip: str | Path | UserClip | MeasuredClip,
    *,
    start: float | None = None,
    seconds: float | None = None,
    fps: float | None = None,
    masks: str | Path | None = None,
    prompts: Prompts | None = None,
    correction: Correction | None = None,
    model: str | Base | WordsModel | LoadingModel = "models/words",
    samples: int = 8,
    temperature: float = 1.0,
    top_p: float = Sampling.top_p,
    middle: float = Sampling.middle,
    search: int = 0,
    incline: bool = False,
    world: World | None = None,
    flow: str | None = None,
    raft: str | Path = "models/raft-small",
    seed: int = 0,
    progress: Progress | None = None,
    when_seen: Callable[[UserClip], None] | None = None,
) -> Inference:
    """Find the scene that a clip shows.

    Args:
        clip: A video, or a folder with one and masks; or what `pipeline.masks` found in one (`Masks.taken`), or a clip
            that was measured (`Inference.clip`), with which `fps`, `masks` and `prompts` count no more.
        start: s, where the clip begins in the video; None: of a long one, where bodies move freely.
        seconds: Its length; None: as long as they move, at most 12 s, or 1 s from `start` on. The models learned from
            1 s.
        fps: Frames a second at which it was shot, where the file's header lies.
        masks: A file or folder of instance masks; `sam2:PATH` or `edgetam:PATH` for a published segmenter; None for
            masks beside the video, or those that our network finds.
        prompts: What is known of the bodies in the video: points, boxes, their number, what to ignore.
        correction: Of the frames: lens distortion, a camera that shakes a little.
        model: A folder or hub name, or a model that is loaded, or is being loaded. It is shown what its checkpoint says
            that it was trained with (model_input.json).
        samples: Answers sampled beside the greedy one.
        temperature: Of sampling words.
        top_p: Share of the distribution that words are sampled from.
        middle: Share of a number's distribution, about its median, from which samples are drawn.
        search: Refine the best answers with so many simulations; 0: do not.
        incline: The ground may slope in the picture: the search may roll the camera.
        world: What is known of the world: view, gravity, a length or a size.
        flow: "raft" or "dis"; None for what the model was trained with, RAFT where that was exact flow.
        raft: Weights of RAFT.
        seed: Of sampling and search.
        progress: Told of each step; None: nothing is printed.
        when_seen: Called with the clip and its masks before anything is inferred from them.

    Returns:
        The scene found, each method's result, and what was assumed.

    Raises:
        VideoError: For a clip or masks that cannot be used.
        ModelError: For a model that cannot be loaded, or that contradicts `flow`.
        ParamsError: For a search that is too small.
        SimulationError: Where no answer can be simulated.
    """
    progress = progress or Progress()
    if 0 < search < LEAST_SEARCH:
        raise ParamsError(f"search: {search} simulations are too few; valid: 0 for none, or at least {LEAST_SEARCH}")
    correction = correction or Correction()
    prompts, name = prompts or Prompts(), str(clip) if isinstance(clip, (str, Path)) else "clip"
    loading = _loading(model)
    source = FlowSource(flow_source(loading.shown, flow, loading.name), shipped(raft))
    if isinstance(clip, MeasuredClip):
        measured = clip
    else:
        seen = (
            clip
            if isinstance(clip, UserClip)
            else VideoStretch(
                place=Path(clip),
                start=start,
                seconds=seconds,
                fps=fps,
                masks=masks,
                prompts=prompts,
                correction=correction,
            )
        )
        measured = measure_clip(seen, loading.shown, source, progress=progress, when_seen=when_seen)
    settings = Settings(
        start=start,
        seconds=seconds,
        fps=fps,
        prompts=prompts,
        correction=correction,
        world=world or World(),
        flow=source,
        question=Question(samples, temperature, top_p, middle, seed),
        search=SearchBudget(search, incline, seed),
    )
    found = find_scenes(
        measured,
        loading,
        question=settings.question,
        world=settings.world,
        budget=settings.search,
        progress=progress,
    )
    return Inference(
        name=name,
        clip=measured,
        settings=settings,
        base=loading.base.result(),
        scenes=found,
        seconds=progress.seconds,
        files=_write_files,
    )


def _loading(model: str | Base | WordsModel | LoadingModel) -> LoadingModel:
    """A model that is being loaded, or is there."""
    if isinstance(model, LoadingModel):
        return model
    return load_in_background(model) if isinstance(model, str) else loaded(model)


def _write_files(folder: Path, found: Inference, progress: Progress) -> None:
    from pipeline.api.infer_files import write_files

    write_files(folder, found, progress)
