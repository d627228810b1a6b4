"""`pipeline.infer`: from a clip to a scene.

The clip is measured (frames, masks, flow), the model is asked, its answers are replayed and ranked, the best of them
and a classical guess are refined by the search, and the best scene of all is the answer.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.api.masks import say
from pipeline.api.result_folder import result_folder
from pipeline.clips.replay import Replay, replay
from pipeline.errors import ParamsError, SimulationError
from pipeline.inference.asking import (
    FLOW_SIZE,
    LoadingModel,
    Question,
    ask_model,
    flow_source,
    input_of,
    load_in_background,
    loaded,
    raw_flow,
    shipped,
    shown_flow,
)
from pipeline.inference.filmed_world import FilmedWorld, World, filmed_world
from pipeline.inference.measured_clip import MeasuredClip, clip_schedule, measured_clip
from pipeline.inference.progress import Progress
from pipeline.inference.scene_search import (
    ClipSearch,
    clip_evaluator,
    distinct_starts,
    scene_certainties,
    search_clip,
)
from pipeline.inference.trust import Forecast, Grade, forecast, grade
from pipeline.metrics.overlap import Overlap, overlap
from pipeline.perception.mask_source import mask_source
from pipeline.perception.prompts import Prompts
from pipeline.perception.user_clip import UserClip, read_frames, with_masks
from pipeline.planar.find_planar_scene import PlanarAnswer
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import Ranking, rank
from pipeline.search.certainty import Certainty, weakly_identified
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.vision.recordings.clip_folder import video_of
from pipeline.vision.recordings.video import check_file

if TYPE_CHECKING:
    from pipeline.inference.answers import Answer
    from pipeline.model.base import Base
    from pipeline.model.generate import Sampling
    from pipeline.objects.answering import ObjectsModel

#: As params.yaml has them for the graph (`search`; a test compares them).
SEARCH_SIZE = (120, 80)  # px of masks and flow in the search's reward
STARTS = 3  # answers that a search starts from
LEAST_SEARCH = 200
FORECAST_SHARE = 0.35  # of the simulations of a search, that are spent again on the first part of the clip
TRACKS = "tracks"  # the method that fits a planar scene to tracks
TRACKS_IOU = 0.6  # from which its scene needs no search beside it, which knows tables alone


@dataclass(frozen=True)
class Settings:
    """What `infer` was asked for; see there."""

    start: float
    seconds: float
    fps: float | None
    prompts: Prompts
    search: int
    incline: bool
    world: World
    flow: str
    raft: Path
    sampling: Sampling
    seed: int


@dataclass(frozen=True)
class Method:
    """A way to a scene, and what it reached.

    Attributes:
        name: "greedy", "best of K", "search" or "tracks".
        scene: What it found.
        answer: The model's, whose words belong to the scene: of a search, the best one with the same shapes; None for
            tracks.
        reward: As the search measures: iou - epe_frame.
        iou: As the search measures.
        epe_frame: px of 480x320 per frame interval, over the whole frame.
        overlap: At the clip's own size.
        simulations: That it took, those of the methods before it included.
    """

    name: str
    scene: Scene
    answer: Answer | None
    reward: float
    iou: float
    epe_frame: float
    overlap: Overlap
    simulations: int


@dataclass(frozen=True)
class Inference:
    """What `infer` found.

    Attributes:
        name: Of the clip.
        clip: What was measured.
        settings: What was asked for.
        base: The model.
        answers: The model's: greedy first, then the samples.
        rewards: Of the answers, in their order.
        methods: Each way to a scene, in the order in which they were tried.
        filmed: The world that the tracks tell of.
        searched: The search; None where there was none.
        forecast: Of frames that were not fitted, by the best method; None where it was not tried.
        certainties: How far the clip determines each number of the scene; empty without a search.
        seconds: The time that each step took.
    """

    name: str
    clip: MeasuredClip
    settings: Settings
    base: Base | ObjectsModel
    answers: tuple[Answer, ...]
    rewards: Rewards
    methods: tuple[Method, ...]
    filmed: FilmedWorld
    searched: ClipSearch | None
    forecast: Forecast | None
    certainties: tuple[Certainty, ...]
    seconds: dict[str, float]

    @property
    def best(self) -> Method:
        """The method with the highest reward."""
        return max(self.methods, key=lambda m: m.reward)

    @property
    def scene(self) -> Scene:
        return self.best.scene

    @property
    def flow_size(self) -> tuple[int, int]:
        """px, width and height, at which the flow was measured."""
        return input_of(self.base).flow_size or FLOW_SIZE

    @property
    def grade(self) -> Grade:
        """How far the answer can be trusted."""
        return grade(self.best.overlap.sequence, self.forecast)

    @property
    def metric(self) -> str:
        """What fixed the scale: "gravity", "length", "size" or "none"."""
        scale = self.filmed.answer.scale if self.filmed.answer and self.best.name == TRACKS else None
        return "none" if scale is None else scale.by

    @property
    def doubts(self) -> list[str]:
        """Why the answer should not be relied on."""
        return list(self.clip.taken.doubts)

    def replay(self) -> Replay:
        """The scene, run over the clip."""
        return replay(self.scene, self.clip.schedule)

    def save(self, out: str | Path, force: bool = False) -> None:
        """Write a folder with scene.yaml, scene.xml, replay.mp4, overlay.png, masks.png, recording.rrd and result.json.

        Args:
            out: The folder, which must not exist yet.
            force: Replace it where `dynamics` wrote it and nothing else is in it.

        Raises:
            OutputError: Where it cannot be written; nothing is left then.
        """
        from pipeline.api.infer_files import write_files

        with result_folder(Path(out), force) as folder:
            write_files(folder, self, Progress())


def infer(
    clip: str | Path | UserClip | MeasuredClip,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float | None = None,
    masks: str | Path | None = None,
    prompts: Prompts | None = None,
    model: str | Base | ObjectsModel | LoadingModel = "models/tiny",
    samples: int = 8,
    temperature: float = 1.0,
    top_p: float = 0.9,
    middle: float = 0.4,
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
        start: s, where the clip begins in the video.
        seconds: Its length; the models learned from 1 s.
        fps: Frames a second at which it was shot, where the file's header lies.
        masks: A file or folder of instance masks; `sam2:PATH` or `edgetam:PATH` for a published segmenter; None for
            masks beside the video, or those that our network finds.
        prompts: What is known of the bodies in the video: points, boxes, their number, what to ignore.
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
    if not isinstance(clip, (UserClip, MeasuredClip)):
        clip_schedule(Path(clip), seconds)
    prompts = prompts or Prompts()
    name = str(clip) if isinstance(clip, (str, Path)) else "clip"
    schedule = clip.schedule if isinstance(clip, MeasuredClip) else clip_schedule(Path(name), seconds)
    if isinstance(clip, (str, Path)):
        masks_from = mask_source(Path(clip), masks, prompts)
        check_file(video_of(Path(clip)))
    loading = _loading(model)
    if isinstance(clip, (str, Path)):
        with progress.step("frames"):
            read = read_frames(
                Path(clip), start=start, seconds=seconds, fps=schedule.fps, assume_fps=fps, source=masks_from
            )
        frames = read.clip
    else:
        taken = clip.taken if isinstance(clip, MeasuredClip) else clip
        frames = taken.clip
    source, weights, shown = flow_source(loading.shown, flow, loading.name), shipped(raft), loading.shown
    if isinstance(clip, MeasuredClip):
        field = clip.flow
    else:
        with ThreadPoolExecutor(1, "flow") as beside:
            measuring = beside.submit(raw_flow, frames, schedule, shown, source, weights)
            if isinstance(clip, (str, Path)):
                with progress.step("masks"):
                    taken = with_masks(read, prompts)
                say(progress, name, start, taken, taken.clip.notes)
            if when_seen is not None:
                when_seen(taken)
            with progress.step("flow"):  # what is left of it after the masks
                field = shown_flow(measuring.result(), taken, schedule, shown)
    with progress.step("answers"):
        question = Question(samples, temperature, top_p, middle, seed)
        answers, sampling = ask_model(loading, taken, schedule, field, question)
    measured = clip if isinstance(clip, MeasuredClip) else measured_clip(name, taken, schedule, field)
    settings = Settings(
        start=start,
        seconds=seconds,
        fps=fps,
        prompts=prompts,
        search=search,
        incline=incline,
        world=world or World(),
        flow=source,
        raft=weights,
        sampling=sampling,
        seed=seed,
    )
    progress.say(
        "answers", f"{_tally([a.scene.composition for a in answers])}; greedy first: {answers[0].scene.composition}"
    )
    with progress.step("best of K"):
        taken = measured.taken
        evaluator = clip_evaluator(
            taken.masks, measured.flow, measured.schedule, SEARCH_SIZE, cores(), taken.clip.frames
        )
        ranking = rank(evaluator, [a.scene for a in answers])
        if not ranking.rewards.valid.any():
            raise SimulationError(f"the simulation is unstable in each of the {len(answers)} answers; try more samples")
        methods = [_answer_method("greedy", answers, ranking.rewards, 0, measured, 1)]
        if len(answers) > 1:
            top = int(ranking.order[0])
            methods.append(_answer_method("best of K", answers, ranking.rewards, top, measured, len(answers)))
    with progress.step("tracks"):
        filmed = filmed_world(measured.taken, settings.world)
    progress.say("view", f"{filmed.motion.view.kind}: {filmed.motion.view.reason}")
    if filmed.answer is not None and filmed.scene is not None:
        methods.append(_tracks_method(filmed.answer, filmed.scene, evaluator, measured))
    searched, forecasts = None, {TRACKS: filmed.forecast}
    if search and not (filmed.scene is not None and methods[-1].overlap.sequence >= TRACKS_IOU):
        with progress.step("search"):
            ranked = [answers[int(i)].scene for i in ranking.order]
            starts = distinct_starts(ranked, ranking.rewards.valid[ranking.order].tolist(), STARTS)
            searched = search_clip(
                evaluator,
                starts,
                search,
                np.random.default_rng(seed),
                lambda spent, reward: progress.detail(f" {spent}/{search} simulations, reward {reward:.3f}"),
                incline,
            )
            forecasts["search"] = _search_forecast(measured, starts, search, seed, incline)
        methods.append(_search_method(searched, answers, ranking, measured))
    best = max(methods, key=lambda m: m.reward)
    certain: tuple[Certainty, ...] = ()
    if searched is not None:
        found = best.scene is searched.result.scene
        certain = searched.certainties if found else scene_certainties(evaluator, best.scene)[1]
    return Inference(
        name=name,
        clip=measured,
        settings=settings,
        base=loading.base.result(),
        answers=tuple(answers),
        rewards=ranking.rewards,
        methods=tuple(methods),
        filmed=filmed,
        searched=searched,
        forecast=forecasts.get(best.name),
        certainties=certain,
        seconds=progress.seconds,
    )


def _loading(model: str | Base | ObjectsModel | LoadingModel) -> LoadingModel:
    """A model that is being loaded, or is there."""
    if isinstance(model, LoadingModel):
        return model
    return load_in_background(model) if isinstance(model, str) else loaded(model)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def uncertain(known: tuple[Certainty, ...]) -> str:
    """The numbers that the clip says little about, as words."""
    return ", ".join(weakly_identified(known)) or "nothing"


def _answer_method(
    name: str, answers: list[Answer], rewards: Rewards, index: int, clip: MeasuredClip, simulations: int
) -> Method:
    scene = answers[index].scene
    shown = _overlap(scene, clip) if rewards.valid[index] else Overlap(0.0, 0.0, 0.0, np.zeros((0, 2), int))
    return Method(
        name=name,
        scene=scene,
        answer=answers[index],
        reward=float(rewards.reward[index]),
        iou=float(rewards.iou[index]),
        epe_frame=float(rewards.epe_frame[index]),
        overlap=shown,
        simulations=simulations,
    )


def _search_method(searched: ClipSearch, answers: list[Answer], ranking: Ranking, clip: MeasuredClip) -> Method:
    found, order = searched.result, [answers[int(i)] for i in ranking.order]
    nearest = next((a for a in order if a.scene.composition == found.scene.composition), order[0])
    return Method(
        name="search",
        scene=found.scene,
        answer=nearest,
        reward=found.reward,
        iou=found.iou,
        epe_frame=found.iou - found.reward,
        overlap=_overlap(found.scene, clip),
        simulations=len(answers) + found.simulations,
    )


def _tracks_method(answer: PlanarAnswer, scene: Scene, evaluator: Evaluator, clip: MeasuredClip) -> Method:
    rewards = rank(evaluator, [scene]).rewards
    shown = _overlap(scene, clip) if rewards.valid[0] else Overlap(0.0, 0.0, 0.0, np.zeros((0, 2), int))
    return Method(
        name=TRACKS,
        scene=scene,
        answer=None,
        reward=float(rewards.reward[0]),
        iou=float(rewards.iou[0]),
        epe_frame=float(rewards.epe_frame[0]),
        overlap=shown,
        simulations=answer.fit.simulations,
    )


def _search_forecast(
    clip: MeasuredClip, starts: list[Scene], simulations: int, seed: int, incline: bool
) -> Forecast | None:
    """How well a search on the first part of the clip forecasts the rest; None where the clip cannot be parted."""
    schedule, masks = clip.schedule, clip.taken.masks
    times = np.arange(len(masks)) / schedule.fps
    budget = max(LEAST_SEARCH, round(FORECAST_SHARE * simulations))

    def find(count: int) -> Scene | None:
        try:
            part = schedule.first(count / schedule.fps)
        except ValueError:
            return None
        evaluator = clip_evaluator(masks, clip.flow, part, SEARCH_SIZE, cores())
        return search_clip(evaluator, starts, budget, np.random.default_rng(seed), incline=incline).result.scene

    return forecast(masks, times, find)


def _overlap(scene: Scene, clip: MeasuredClip) -> Overlap:
    return overlap(replay(scene, clip.schedule).masks, clip.taken.masks, len(scene.objects), clip.objects)


def _tally(compositions: list[str]) -> str:
    """`box+sphere (6), sphere (3)`: compositions and how often each was answered, the most frequent first."""
    return ", ".join(f"{name} ({count})" for name, count in Counter(compositions).most_common(4))
