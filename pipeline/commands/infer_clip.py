"""A clip becomes a scene: decode, measure, ask the model, rank its answers, search, and show what came out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.commands.answers import Answer, ask, model_pictures, tally
from pipeline.commands.clip_input import FLOW_SIZE, ClipInput, clip_schedule, read_input
from pipeline.commands.infer_outputs import Outcome, write_outputs
from pipeline.commands.progress import Progress
from pipeline.commands.replay import replay, run_scene
from pipeline.commands.result_folder import result_folder, write_result
from pipeline.commands.scoring import Overlap, evaluator_of, overlap, ranked
from pipeline.commands.table import Row, aligned
from pipeline.errors import ParamsError
from pipeline.model.base import load_base
from pipeline.model.generate import Sampling
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import Ranking
from pipeline.search.certainty import Certainty, certainties, weakly_identified
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.search.search_result import SearchResult
from pipeline.search.search_scene import search_scene
from pipeline.shards.content_hash import hash_path
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.raft import RAFT, load_raft

LEAST_SEARCH = 200
STARTS = 3
_VERSIONS = ("dynamics-pipeline", "mujoco", "numpy", "opencv-python-headless", "rerun-sdk", "torch", "transformers")
SCALE = (
    "one camera cannot tell how large things are: lengths are such that the camera stands 2 m before the middle; "
    "masses of bodies that hit nothing movable are guesses"
)

DOUBTFUL_IOU = 0.2
DOUBT = "the replay hardly meets what moves in the clip: do not rely on this answer"


@dataclass(frozen=True)
class Request:
    """What `dynamics infer` was asked for; see its --help."""

    clip: Path
    out: Path
    start: float
    seconds: float
    fps: float | None
    masks: Path | None
    search: int
    incline: bool
    model: str
    flow: str
    raft: Path
    shown: str
    sampling: Sampling
    seed: int
    force: bool


@dataclass(frozen=True)
class Method:
    """A way to an answer and what it reached. reward, iou, epe_frame: as the search measures; overlap: at full size;
    simulations: how many it took, those before it included."""

    name: str
    scene: Scene
    answer: Answer
    reward: float
    iou: float
    epe_frame: float
    overlap: Overlap
    simulations: int


def infer_clip(request: Request) -> None:
    """Do it all and write the output folder. Raises DynamicsError; nothing is written then."""
    clip_schedule(request.clip, request.seconds)
    if 0 < request.search < LEAST_SEARCH:
        raise ParamsError(f"--search {request.search} is too small; valid: 0 for none, or at least {LEAST_SEARCH}")
    steps = 5 + bool(request.search)
    with result_folder(request.out, request.force) as folder, Progress(steps) as progress:
        estimator: RAFT | DIS = load_raft(request.raft) if request.flow == "raft" else DIS("medium")
        clip = read_input(request.clip, request.start, request.seconds, request.fps, request.masks, estimator, progress)
        _say_input(progress, request, clip)
        with progress.step("answers"):
            answers = _answers(request, clip)
        progress.say("answers", f"{tally([a.parsed.scene.composition for a in answers])}; greedy first: "
                                f"{answers[0].parsed.scene.composition}")  # fmt: skip
        with progress.step("best of K"):
            evaluator = evaluator_of(clip)
            ranking = ranked(evaluator, [a.parsed.scene for a in answers])
            methods = [_method("greedy", answers[0], ranking.rewards, 0, clip, 1)]
            if len(answers) > 1:
                top = int(ranking.order[0])
                methods.append(_method("best of K", answers[top], ranking.rewards, top, clip, len(answers)))
        found: SearchResult | None = None
        if request.search:
            with progress.step("search"):
                found = _searched(request, evaluator, answers, ranking, progress)
            methods.append(_found_method(found, answers, ranking, clip))
        best = max(methods, key=lambda m: m.reward)
        rows = _table(methods)
        for line in aligned(rows):
            progress.say("", line)
        known = certainties(evaluator, best.scene, evaluator.pairs(best.scene)) if found else []
        if known:
            progress.say("note", f"hardly determined by this clip: {', '.join(weakly_identified(known)) or 'nothing'}")
        doubt = [DOUBT] if best.overlap.sequence < DOUBTFUL_IOU else []
        for line in doubt:
            progress.say("note", line)
        with progress.step("pictures"):
            run = replay(best.scene, run_scene(best.scene, clip.schedule), clip.schedule)
            title = f"{request.clip.name}: {best.scene.composition} ({best.name})"
            outcome = Outcome(request.clip.stem, title, tuple(rows), clip, run,
                              best.overlap.pairs, best.answer.parsed.think, (*clip.notes, *doubt))  # fmt: skip
            renderer = write_outputs(folder, outcome)
        progress.say("pictures", f"of the replay: {renderer}")
        write_result(folder, "infer", _result(request, clip, answers, ranking.rewards, methods, best, doubt, found,
                                              known, renderer, run.event_texts, progress.seconds))  # fmt: skip
    print(f"{'written':<11}{request.out}: look at overlay.png first")


def _answers(request: Request, clip: ClipInput) -> list[Answer]:
    base = load_base(request.model, frames=clip.schedule.model_frames)
    first = clip.schedule.pairs[:, 0]
    shown = model_pictures(clip.flow, clip.taken.clip.frames[first], request.shown, 1 / clip.schedule.fps, base)
    return ask(base, shown, request.sampling, request.seed)


def _searched(
    request: Request, evaluator: Evaluator, answers: list[Answer], ranking: Ranking, progress: Progress
) -> SearchResult:
    """The search from the best answers that differ, and from a classical guess."""
    told = f"/{request.search} simulations, reward "
    return search_scene(
        evaluator, _starts(answers, ranking), request.search, np.random.default_rng(request.seed),
        lambda spent, reward: progress.detail(f" {spent}{told}{reward:.3f}"), request.incline,
    ).result  # fmt: skip


def _starts(answers: list[Answer], ranking: Ranking) -> list[Scene]:
    order = [answers[int(i)].parsed.scene for i in ranking.order if ranking.rewards.valid[i]]
    return list(dict.fromkeys(order))[:STARTS]


def _found_method(found: SearchResult, answers: list[Answer], ranking: Ranking, clip: ClipInput) -> Method:
    """The search's own line; its words are those of the best answer with the same shapes."""
    order = [answers[int(i)] for i in ranking.order]
    nearest = next((a for a in order if a.parsed.scene.composition == found.scene.composition), order[0])
    return Method("search", found.scene, nearest, found.reward, found.iou, found.iou - found.reward,
                  _seen(found.scene, clip), len(answers) + found.simulations)  # fmt: skip


def _method(name: str, answer: Answer, rewards: Rewards, index: int, clip: ClipInput, simulations: int) -> Method:
    scene = answer.parsed.scene
    shown = _seen(scene, clip) if rewards.valid[index] else Overlap(0.0, 0.0, 0.0, np.zeros((0, 2), int))
    return Method(name, scene, answer, float(rewards.reward[index]), float(rewards.iou[index]),
                  float(rewards.epe_frame[index]), shown, simulations)  # fmt: skip


def _seen(scene: Scene, clip: ClipInput) -> Overlap:
    masks = replay(scene, run_scene(scene, clip.schedule), clip.schedule).masks
    return overlap(masks, len(scene.objects), clip)


def _table(methods: list[Method]) -> list[Row]:
    """Cells, a heading first."""
    rows: list[Row] = [("method", "objects", "IoU", "reward", "flow error", "simulations")]
    for m in methods:
        numbers = (f"{m.overlap.sequence:.2f}", f"{m.reward:.2f}", f"{m.epe_frame:.2f} px", str(m.simulations))
        rows.append((m.name, m.scene.composition, *numbers))
    return rows


def _say_input(progress: Progress, request: Request, clip: ClipInput) -> None:
    taken = clip.taken.clip
    width, height = taken.source_size
    span = f"{request.start:g} to {request.start + request.seconds:g} s"
    progress.say("clip", f"{request.clip}: {span}, {width}x{height}, {taken.source_fps:.4g} FPS")
    for note in clip.notes:
        progress.say("note", note)
    many = "object" if clip.objects == 1 else "objects"
    progress.say("masks", f"{clip.objects} {many}, from {clip.taken.masks_from}")


def _result(
    request: Request, clip: ClipInput, answers: list[Answer], rewards: Rewards, methods: list[Method], best: Method,
    doubt: list[str], found: SearchResult | None, known: list[Certainty], renderer: str, events: list[str],
    seconds: dict[str, float],
) -> dict[str, Any]:  # fmt: skip
    taken, sampling = clip.taken.clip, request.sampling
    return {
        "clip": str(request.clip),
        "assumed": {
            "start_s": request.start,
            "seconds": request.seconds,
            "recorded_fps": round(taken.source_fps, 4),
            "fps_from": "the file" if request.fps is None else "--fps",
            "resampled_fps": clip.schedule.fps,
            "source_size_px": list(taken.source_size),
            "cropped_to_px": list(taken.letterbox.window),
            "size_px": list(taken.letterbox.size),
            "masks_from": clip.taken.masks_from,
            "instances": clip.objects,
            "camera": "at rest, at (0, -2, h) m, looking along +y; square pixels, no distortion",
            "incline": request.incline,
            "scale": SCALE,
            "notes": list(clip.notes),
        },
        "flow": {"by": request.flow, "weights": str(request.raft) if request.flow == "raft" else None,
                 "size_px": list(FLOW_SIZE)},
        "model": {"name": request.model, "sha256": _hash(request.model), "shown": request.shown,
                  "reasoning": sampling.reasoning, "samples": sampling.samples, "temperature": sampling.temperature,
                  "top_p": sampling.top_p, "middle": sampling.middle, "seed": request.seed},
        "answer": {"from": best.name, "composition": best.scene.composition, "think": best.answer.parsed.think,
                   "events_of_replay": events, "doubts": doubt},
        "methods": [
            {"method": m.name, "composition": m.scene.composition, "reward": _number(m.reward), "iou": _number(m.iou),
             "epe_frame_px": _number(m.epe_frame), "sequence_iou": _number(m.overlap.sequence),
             "initial_iou": _number(m.overlap.initial), "foreground_iou": _number(m.overlap.foreground),
             "sample": m.answer.sample, "simulations": m.simulations}
            for m in methods
        ],
        "samples": [
            {"sample": a.sample, "composition": a.parsed.scene.composition, "reward": _number(rewards.reward[i]),
             "log_probability": _number(a.log_probability)}
            for i, a in enumerate(answers)
        ],
        "search": None if found is None else {
            "simulations": found.simulations, "invalid": found.invalid, "seconds": round(found.seconds, 2),
            "spent": found.spent.tolist(),
            "history": [_number(v) for v in found.history],
        },
        "certainty": [
            {"place": c.place, "value": _number(c.value), "spread": _number(c.spread), "unit": c.unit,
             "determined": c.determined}
            for c in known
        ],
        "renderer": renderer,
        "seconds": seconds,
        "made": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        "versions": {name: version(name) for name in _VERSIONS},
    }  # fmt: skip


def _hash(model: str) -> str | None:
    return hash_path(Path(model)) if Path(model).is_dir() else None


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
