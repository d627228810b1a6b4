"""`pipeline.infer`: from a clip to a scene.

The clip is measured (frames, masks, flow), the model is asked, its answers are replayed and ranked, the best of them
and a classical guess are refined by the search, and the best scene of all is the answer.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.api.result_folder import result_folder
from pipeline.clips.replay import Replay, replay
from pipeline.clips.schedule import Schedule
from pipeline.errors import ParamsError, SimulationError, naming
from pipeline.inference.answers import Answer, answer_seed, ask
from pipeline.inference.measured_clip import MeasuredClip, clip_schedule, measure_clip
from pipeline.inference.model_pictures import model_pictures
from pipeline.inference.progress import Progress
from pipeline.inference.scene_search import (
    ClipSearch,
    clip_evaluator,
    distinct_starts,
    scene_certainties,
    search_clip,
)
from pipeline.metrics.overlap import Overlap, overlap
from pipeline.model.base import Base, load_base
from pipeline.model.generate import Sampling
from pipeline.model.model_input import ModelInput, missing_input
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import Ranking, rank
from pipeline.search.certainty import Certainty, weakly_identified
from pipeline.search.evaluator import Rewards
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import RAFT, load_raft

ROOT = Path(__file__).resolve().parents[2]
#: As params.yaml has them for the graph (`search`, `flow`, `infer`; a test compares them).
SEARCH_SIZE = (120, 80)  # px of masks and flow in the search's reward
STARTS = 3  # answers that a search starts from
DECODE_BATCH_SIZE = 64  # sequences decoded at a time
FLOW_SIZE, FLOW_ITERATIONS = (240, 160), 4  # of flow for a model that is not shown any
LEAST_SEARCH = 200
DOUBTFUL_IOU = 0.2
DOUBT = "the replay overlaps little of what moves in the clip: do not rely on this answer"


@dataclass(frozen=True)
class Settings:
    """What `infer` was asked for; see there."""

    start: float
    seconds: float
    fps: float | None
    search: int
    incline: bool
    flow: str
    raft: Path
    sampling: Sampling
    seed: int


@dataclass(frozen=True)
class Method:
    """A way to a scene, and what it reached.

    Attributes:
        name: "greedy", "best of K" or "search".
        scene: What it found.
        answer: The model's, whose words belong to the scene: of a search, the best one with the same shapes.
        reward: As the search measures: iou - epe_frame.
        iou: As the search measures.
        epe_frame: px of 480x320 per frame interval, over the whole frame.
        overlap: At the clip's own size.
        simulations: That it took, those of the methods before it included.
    """

    name: str
    scene: Scene
    answer: Answer
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
        searched: The search; None where there was none.
        certainties: How far the clip determines each number of the scene; empty without a search.
        seconds: The time that each step took.
    """

    name: str
    clip: MeasuredClip
    settings: Settings
    base: Base
    answers: tuple[Answer, ...]
    rewards: Rewards
    methods: tuple[Method, ...]
    searched: ClipSearch | None
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
    def doubts(self) -> list[str]:
        """Why the answer should not be relied on."""
        return [DOUBT] if self.best.overlap.sequence < DOUBTFUL_IOU else []

    def replay(self) -> Replay:
        """The scene, run over the clip."""
        return replay(self.scene, self.clip.schedule)

    def save(self, out: str | Path, force: bool = False) -> None:
        """Write a folder with scene.yaml, scene.xml, replay.mp4, overlay.png, recording.rrd and result.json.

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
    clip: str | Path | MeasuredClip,
    *,
    start: float = 0.0,
    seconds: float = 1.0,
    fps: float | None = None,
    masks: str | Path | None = None,
    model: str | Base = "models/tiny",
    samples: int = 8,
    temperature: float = 1.0,
    top_p: float = 0.9,
    middle: float = 0.4,
    search: int = 0,
    incline: bool = False,
    flow: str | None = None,
    raft: str | Path = "models/raft-small",
    seed: int = 0,
    progress: Progress | None = None,
) -> Inference:
    """Find the scene that a clip shows.

    Args:
        clip: A video, or a folder with one and masks; or a clip that was measured (`Inference.clip`), with which
            `fps` and `masks` count no more.
        start: s, where the clip begins in the video.
        seconds: Its length; the models learned from 1 s.
        fps: Frames a second at which it was shot, where the file's header lies.
        masks: A file or folder of instance masks; None for those beside the video, or from motion.
        model: A folder or hub name, or a model that is loaded. It is shown what its checkpoint says that it was
            trained with (model_input.json).
        samples: Answers sampled beside the greedy one.
        temperature: Of sampling words.
        top_p: Share of the distribution that words are sampled from.
        middle: Share of a number's distribution, about its median, from which samples are drawn.
        search: Refine the best answers with so many simulations; 0: do not.
        incline: The ground may slope in the picture: the search may roll the camera.
        flow: "raft" or "dis"; None for what the model was trained with, RAFT where that was exact flow.
        raft: Weights of RAFT.
        seed: Of sampling and search.
        progress: Told of each step; None: nothing is printed.

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
    if not isinstance(clip, MeasuredClip):
        clip_schedule(Path(clip), seconds)
    base = model if isinstance(model, Base) else load_model(model)
    shown = input_of(base)
    source = _flow_source(base, shown, flow)
    sampling = Sampling(samples, temperature, top_p, shown.reasoning, seconds, middle=middle)
    settings = Settings(start, seconds, fps, search, incline, source, shipped(raft), sampling, seed)
    name, measured = _measured(clip, settings, shown, None if masks is None else Path(masks), progress)
    with progress.step("answers"):
        first, interval = measured.schedule.pairs[:, 0], 1 / measured.schedule.fps
        pictures = model_pictures(shown, base.layout, measured.flow, measured.taken.clip.frames[first], interval)
        (answers,) = ask(base, lambda _: pictures, [answer_seed(seed, 0)], sampling, DECODE_BATCH_SIZE)
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
    searched = None
    if search:
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
        methods.append(_search_method(searched, answers, ranking, measured))
    best = max(methods, key=lambda m: m.reward)
    known: tuple[Certainty, ...] = ()
    if searched is not None:
        found = best.scene is searched.result.scene
        known = searched.certainties if found else scene_certainties(evaluator, best.scene)[1]
    return Inference(
        name=name,
        clip=measured,
        settings=settings,
        base=base,
        answers=tuple(answers),
        rewards=ranking.rewards,
        methods=tuple(methods),
        searched=searched,
        certainties=known,
        seconds=progress.seconds,
    )


def load_model(name: str, parameter: str = "model") -> Base:
    """The model in a folder, or of that name in the local hub cache.

    Args:
        name: Also that of a folder which ships with this project.
        parameter: What the user calls it, for the message of an error.

    Raises:
        ModelError: Where it cannot be loaded, or has not recorded how its input is made.
    """
    with naming(parameter):
        base = load_base(str(shipped(name)), frames=Schedule().model_frames)
        input_of(base)
        return base


def input_of(base: Base) -> ModelInput:
    """How the model's input is made. Raises ModelError where the checkpoint has not recorded that."""
    if base.input is None:
        raise missing_input(base.name)
    return base.input


def shipped(path: str | Path) -> Path:
    """A path as given; where it is not there from here, the same path in this project (models/tiny), if it is there."""
    place = Path(path)
    return ROOT / place if not place.exists() and not place.is_absolute() and (ROOT / place).exists() else place


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def uncertain(known: tuple[Certainty, ...]) -> str:
    """The numbers that the clip says little about, as words."""
    return ", ".join(weakly_identified(known)) or "nothing"


def _flow_source(base: Base, shown: ModelInput, flow: str | None) -> str:
    """How flow is measured: as asked for, else as in training."""
    if flow is not None and flow not in ("raft", "dis"):
        raise ParamsError(f"flow: {flow!r}; valid: raft, dis")
    if flow is not None and shown.input == "flow":
        shown.check("flow_source", flow, "flow", base.name)
    trained = shown.flow_source if shown.flow_source in ("raft", "dis") else "raft"
    return flow or trained


def _measured(
    clip: str | Path | MeasuredClip, settings: Settings, shown: ModelInput, masks: Path | None, progress: Progress
) -> tuple[str, MeasuredClip]:
    """The clip's name and what was measured."""
    if isinstance(clip, MeasuredClip):
        return "clip", clip
    estimator: RAFT | DIS = load_raft(settings.raft) if settings.flow == "raft" else DIS("medium")
    measured = measure_clip(
        Path(clip),
        estimator,
        shown.flow_size or FLOW_SIZE,
        shown.flow_iterations or FLOW_ITERATIONS,
        start=settings.start,
        seconds=settings.seconds,
        fps=settings.fps,
        masks=masks,
        progress=progress,
    )
    taken = measured.taken.clip
    width, height = taken.source_size
    span = f"{settings.start:g} to {settings.start + settings.seconds:g} s"
    progress.say("clip", f"{clip}: {span}, {width}x{height}, {taken.source_fps:.4g} FPS")
    for note in measured.notes:
        progress.say("note", note)
    many = "object" if measured.objects == 1 else "objects"
    progress.say("masks", f"{measured.objects} {many}, from {measured.taken.masks_from}")
    return str(clip), measured


def _answer_method(
    name: str, answers: list[Answer], rewards: Rewards, index: int, clip: MeasuredClip, simulations: int
) -> Method:
    scene = answers[index].scene
    shown = _seen(scene, clip) if rewards.valid[index] else Overlap(0.0, 0.0, 0.0, np.zeros((0, 2), int))
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
        overlap=_seen(found.scene, clip),
        simulations=len(answers) + found.simulations,
    )


def _seen(scene: Scene, clip: MeasuredClip) -> Overlap:
    return overlap(replay(scene, clip.schedule).masks, clip.taken.masks, len(scene.objects), clip.objects)


def _tally(compositions: list[str]) -> str:
    """`box+sphere (6), sphere (3)`: compositions and how often each was answered, the most frequent first."""
    return ", ".join(f"{name} ({count})" for name, count in Counter(compositions).most_common(4))
