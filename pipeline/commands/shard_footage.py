"""What the shards of a suite know of one clip, gathered for the viewer.

The stages of one suite lie beside each other (data/<stage>/<suite>): whichever is opened, the others add what they
have. Tables and arrays are known by their names, so that a stage which writes them is shown too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks
from pipeline.commands.replay import run_scene
from pipeline.errors import ShardError
from pipeline.language.events import Event
from pipeline.physics.trace import Trace
from pipeline.physics.trace_shards import STATE_NAMES, read_trace
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.shards.dataset import Clip, open_shards
from pipeline.shards.manifest import MANIFEST
from pipeline.shards.shard import MAIN_TABLE
from pipeline.viewer.footage import Footage, MotionLayer, Pictures
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_rgb

#: Stages whose rows are answers, the furthest first; the truth is in `sample`.
ANSWERS = ("fit", "cmaes", "best_of_k", "infer")
TRUTH = "sample"


@dataclass(frozen=True)
class Opened:
    """A clip of every stage of its suite, by stage; and which stage the user pointed at."""

    stage: str
    suite: str
    clips: dict[str, Clip]
    schedule: Schedule
    notes: list[str]


def shard_folder(place: Path) -> tuple[Path, str | None] | None:
    """The folder of shards (with a manifest) that holds `place`, and the shard's name where it is one; None if none."""
    for folder in (place, place.parent, place.parent.parent):
        if (folder / MANIFEST).is_file():
            return folder, None if folder == place else place.name.split(".")[0]
    return None


def open_clip(folder: Path, shard: str | None, index: int | None) -> Opened:
    """A clip of the stage at `folder` and of its sisters; index None: the first, of the shard where one is named.

    Raises ShardError.
    """
    dataset = open_shards(folder)
    if index is None:
        starts = [s.start for s in dataset.shards if shard is None or s.entry.name == shard]
        index = starts[0] if starts else 0
    if not 0 <= index < len(dataset):
        raise ShardError(f"--clip {index}: {folder} has the clips 0 to {len(dataset) - 1}")
    place = folder.resolve()
    datasets, notes = {place.parent.name: dataset}, []
    for sister in sorted(place.parent.parent.glob(f"*/{place.name}/{MANIFEST}")):
        try:
            other = open_shards(sister.parent)
        except ShardError as error:
            notes.append(f"left out: {error}")
            continue
        if other.manifest.suite == dataset.manifest.suite and index < len(other):
            datasets.setdefault(sister.parent.parent.name, other)
    clips = {name: d[index] for name, d in datasets.items()}
    by_stage = {d.manifest.stage: clips[name] for name, d in datasets.items()}
    for name, clip in clips.items():
        for source, content in clip.shard.entry.inputs.items():
            there = by_stage.get(source.split("/")[0])
            if there is not None and there.shard.entry.content != content:
                notes.append(f"{name} was made from other clips than {source} now has: run `dvc repro`")
    schedules = [d.manifest.parts.get("parameters", {}).get("schedule") for d in datasets.values()]
    schedule = next((Schedule(**values) for values in schedules if values), Schedule())
    return Opened(place.parent.name, dataset.manifest.suite, clips, schedule, notes)


def footage(opened: Opened) -> Footage:
    """The clip's motions, pictures and events. Raises ShardError where none of its stages has anything to see."""
    schedule = opened.schedule
    motions = []
    truth = _row(opened, TRUTH)
    if truth is not None:
        scene = read_scene(truth["scene"])
        motions.append(MotionLayer("truth", scene, _trace(opened, scene), True, _events(opened)))
    answer = _answer(opened)
    if answer is not None:
        stage, row = answer
        scene = read_scene(row["scene"])
        motions.append(MotionLayer(stage, scene, run_scene(scene, schedule), truth is None))
        scores = [f"{name} {row[name]:.2f}" for name in ("reward", "iou") if row.get(name) is not None]
        opened.notes.extend([f"{stage}: {', '.join(scores)}"] if scores else [])
    seen = _pictures(opened)
    if not motions and seen.size is None:
        has = ", ".join(sorted({t for c in opened.clips.values() for t in c.shard.tables}))
        raise ShardError(f"{next(iter(opened.clips.values())).shard.folder} has nothing to see: only the tables {has}")
    index = next(iter(opened.clips.values())).index
    return Footage(
        f"{opened.suite}/{index}",
        _notes(opened, motions, index),
        tuple(motions),
        seen,
        _replayed(motions, seen, schedule) if answer is not None else Pictures(),
        schedule.fps,
        ("clip", answer[0] if answer is not None else "replay"),
    )


def _row(opened: Opened, stage: str) -> dict[str, Any] | None:
    clip = opened.clips.get(stage)
    rows = clip.rows() if clip is not None and MAIN_TABLE in clip.shard.tables else []
    return next((r for r in rows if r.get("scene")), None)


def _answer(opened: Opened) -> tuple[str, dict[str, Any]] | None:
    """The stage and the row of an answer: of the stage that was opened, else of the furthest there is."""
    order = [s for s in (opened.stage, *ANSWERS) if s in ANSWERS]
    for stage in order:
        row = _row(opened, stage)  # the first: the greedy answer, or the best
        if row is not None:
            return stage, row
    return None


def _trace(opened: Opened, scene: Scene) -> Trace:
    for clip in opened.clips.values():
        if set(STATE_NAMES) <= set(clip.shard.arrays) and "contacts" in clip.shard.tables:
            return read_trace(clip.shard, clip.index)
    return run_scene(scene, opened.schedule)


def _events(opened: Opened) -> tuple[Event, ...]:
    for clip in opened.clips.values():
        if "events" in clip.shard.tables:
            return tuple(Event(e["time"], e["kind"], e["first"], None if e["second"] < 0 else e["second"])
                         for e in clip.rows("events"))  # fmt: skip
    return ()


def _pictures(opened: Opened) -> Pictures:
    """RGB, masks, depth and flow; the flow that was measured before the exact one, and what the user opened first."""
    found: dict[str, np.ndarray] = {}
    order = [opened.stage, "flow", *opened.clips]
    for stage in (s for s in order if s in opened.clips):
        clip = opened.clips[stage]
        for name in ("rgb", "mask", "depth", "flow"):
            if name in clip.shard.arrays and name not in found:
                found[name] = clip.array(name)
    first = opened.schedule.pairs[:, 0]
    sizes = {a.shape[1:3] for a in found.values()}
    if len(sizes) > 1:
        found.pop("flow", None)
        opened.notes.append("the flow has another size than the pictures and is left out")
    return Pictures(found.get("rgb"), found.get("mask"), found.get("depth"), first, found.get("flow"), first)


def _replayed(motions: list[MotionLayer], seen: Pictures, schedule: Schedule) -> Pictures:
    """The answer as the camera sees it, at the size of the clip's pictures."""
    motion = motions[-1]
    width, height = seen.size or (240, 160)
    steps = schedule.frame_steps
    look = plain_appearance(len(motion.scene.objects))
    positions, quaternions = motion.trace.position[steps], motion.trace.quaternion[steps]
    rgb = render_rgb(motion.scene, positions, quaternions, look, width, height, "raycast")
    return Pictures(rgb, frame_masks(motion.scene, motion.trace, schedule, width, height))


def _notes(opened: Opened, motions: list[MotionLayer], index: int) -> str:
    lines = [f"### clip {index} of {opened.suite}", ""]
    lines += [f"- **{m.name}**: {m.scene.composition}" for m in motions]
    lines += [f"- {note}" for note in opened.notes]
    lines += ["", "from the stages " + ", ".join(opened.clips)]
    for stage in ("tokenize", "events"):
        clip = opened.clips.get(stage)
        for column in ("completion", "think"):
            row = clip.rows()[0] if clip is not None and MAIN_TABLE in clip.shard.tables else {}
            if column in row:
                return "\n".join([*lines, "", "```", row[column], "```"])
    return "\n".join(lines)
