"""What `dynamics view` shows: a clip of a shard, a scene, or a recording.

The stages of one suite lie beside each other (data/<stage>/<suite>): whichever is opened, the others add what they
have. Tables and arrays are known by their names, so that a stage which writes them is shown too.
"""

from __future__ import annotations

import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.api.scene_source import read_scene_source, with_camera
from pipeline.api.simulate import run_schedule
from pipeline.clips.events import Event, event_of_row
from pipeline.clips.replay import Replay, replay_trace
from pipeline.clips.schedule import Schedule
from pipeline.errors import OutputError, SceneError, ShardError
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.physics.trace_shards import STATE_NAMES, read_trace
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene, write_scene
from pipeline.shards.arrays import open_arrays
from pipeline.shards.dataset import Clip, open_shards
from pipeline.shards.manifest import MANIFEST
from pipeline.shards.output_errors import writing_to
from pipeline.shards.shard import MAIN_TABLE
from pipeline.shards.tables import CLIP_COLUMN, read_table
from pipeline.viewer import recording
from pipeline.viewer.footage import Footage, MotionLayer, Pictures

RECORDING = "recording.rrd"
#: Stages whose rows are answers, the furthest first; the truth is in `sample`.
ANSWERS = ("fit", "cmaes", "best_of_k", "infer")
TRUTH = "sample"


def show(place: Path, clip: int | None, seconds: float, file: Path | None) -> None:
    """Show what is at `place`, or write it to `file`. Raises DynamicsError."""
    if file is not None and file.suffix != ".rrd":
        raise OutputError(f"--save {file}: valid: a name that ends in .rrd")
    if file is not None and (file.is_dir() or not file.absolute().parent.is_dir()):
        raise OutputError(f"--save {file}: it is a folder, or there is none to write it into; valid: a file's name")
    if file is None and not has_display():
        raise OutputError(
            "there is no display here for the viewer: give --save FILE.rrd, and open that file with `rerun FILE.rrd` "
            "on a machine with a display, or in a browser at https://rerun.io/viewer"
        )
    made = place / RECORDING if place.is_dir() else place
    if made.suffix == ".rrd" and made.is_file():
        _show_file(made, file)
        return
    shown = _footage(place, clip, seconds)
    what = ", ".join(f"{m.name} ({m.scene.composition})" for m in shown.motions)
    print(f"showing    {shown.name}: {what or 'pictures'}")
    if file is None:
        recording.show(shown)
    else:
        recording.save(shown, file)
        print(f"written    {file}: open it with `rerun {file}`")


def has_display() -> bool:
    """Whether a window can be opened."""
    return not sys.platform.startswith("linux") or any(os.environ.get(k) for k in ("DISPLAY", "WAYLAND_DISPLAY"))


def _footage(place: Path, clip: int | None, seconds: float) -> Footage:
    if not place.exists():
        raise ShardError(
            f"{place}: there is nothing; valid: a folder of shards (data/render/id), one of its files, a scene (YAML), "
            "or a folder that `dynamics` wrote"
        )
    shards = shard_folder(place)
    if shards is not None:
        return clip_footage(open_clip(*shards, clip))
    if place.suffix == ".parquet":
        return scene_footage(*_table_scene(place, clip), seconds)
    if place.suffix == ".zarr":
        return _array_footage(place, clip or 0)
    if clip is not None:
        raise SceneError(f"--clip {clip}: {place} is a scene, not clips")
    return scene_footage(read_scene_source(place), place.stem or place.resolve().name, seconds)


def scene_footage(scene: Scene, name: str, seconds: float) -> Footage:
    """A scene that is run for `seconds`, as its camera sees it, or one that sees it all."""
    schedule = run_schedule(seconds)
    trace = simulate(scene, schedule.seconds)
    seen, note = with_camera(scene, trace.position)
    text = "\n".join([f"### {name}", "", *([f"- {note}"] if note else []), "", "```yaml", write_scene(scene), "```"])
    if seen.camera is None:
        return Footage(name, text, (MotionLayer("scene", seen, trace),), times=schedule.times)
    run = replay_trace(seen, trace, schedule)
    motion = MotionLayer("scene", seen, trace, True, run.events)
    return Footage(name, text, (motion,), _run_pictures(run), times=schedule.times)


def _run_pictures(run: Replay) -> Pictures:
    return Pictures(run.pictures("raycast"), run.masks, run.depth, run.flow, run.schedule.pairs[:, 0])


def _table_scene(path: Path, clip: int | None) -> tuple[Scene, str]:
    """The scene of a clip in a table without its manifest."""
    try:
        table = read_table(path)
    except (OSError, ValueError) as error:
        raise ShardError(f"{path} is damaged, or no Parquet file ({error})") from error
    if not {CLIP_COLUMN, "scene"} <= set(table.column_names):
        raise ShardError(f"{path} has no columns `clip` and `scene`, only {', '.join(table.column_names)}")
    clips = table.column(CLIP_COLUMN).to_pylist()
    wanted = clips[0] if clip is None and clips else clip
    if wanted not in clips:
        raise ShardError(f"{path} has no clip {wanted}; valid: {_some(clips)}")
    return read_scene(table.column("scene")[clips.index(wanted)].as_py(), str(path)), f"{path.stem}/{wanted}"


def _array_footage(path: Path, clip: int) -> Footage:
    """The pictures of a clip in a group of arrays without its manifest."""
    try:
        group = open_arrays(path)
        found = {name: group[name] for name in ("rgb", "mask", "flow") if name in group}
    except (OSError, ValueError, KeyError) as error:
        raise ShardError(f"{path} is damaged, or no Zarr group ({error})") from error
    if not found:
        raise ShardError(f"{path} has no pictures (rgb, mask, flow), only {', '.join(group) or 'nothing'}")
    count = min(map(len, found.values()))
    if not 0 <= clip < count:
        raise ShardError(f"--clip {clip}: {path} has the clips 0 to {count - 1}")
    read = {name: array[clip] for name, array in found.items()}
    flow = read.get("flow")
    frames = np.arange(0) if flow is None else Schedule(model_frames=len(flow)).pairs[:, 0]
    return Footage(
        f"{path.stem}/{clip}",
        f"### clip {clip} of `{path}`",
        (),
        Pictures(read.get("rgb"), read.get("mask"), flow=flow, frames=frames),
        times=Schedule().times,
    )


def _show_file(made: Path, file: Path | None) -> None:
    print(f"showing    {made}")
    if file is None:
        recording.show(made)
        return
    with writing_to(file):
        shutil.copyfile(made, file)
    print(f"written    {file}: open it with `rerun {file}`")


def _some(values: list[int]) -> str:
    shown = sorted(set(values))
    return ", ".join(map(str, shown)) if len(shown) <= 12 else f"{shown[0]} to {shown[-1]}"


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


def clip_footage(opened: Opened) -> Footage:
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
        motions.append(MotionLayer(stage, scene, simulate(scene, schedule.seconds), truth is None))
        scores = [f"{name} {row[name]:.2f}" for name in ("reward", "iou") if row.get(name) is not None]
        opened.notes.extend([f"{stage}: {', '.join(scores)}"] if scores else [])
    seen = _pictures(opened)
    if not motions and seen.size is None:
        has = ", ".join(sorted({t for c in opened.clips.values() for t in c.shard.tables}))
        raise ShardError(f"{next(iter(opened.clips.values())).shard.folder} has nothing to see: only the tables {has}")
    index = next(iter(opened.clips.values())).index
    return Footage(
        name=f"{opened.suite}/{index}",
        notes=_notes(opened, motions, index),
        motions=tuple(motions),
        seen=seen,
        replayed=_replayed(motions, seen, schedule) if answer is not None else Pictures(),
        times=schedule.times,
        titles=("clip", answer[0] if answer is not None else "replay"),
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
    return simulate(scene, opened.schedule.seconds)


def _events(opened: Opened) -> tuple[Event, ...]:
    for clip in opened.clips.values():
        if "events" in clip.shard.tables:
            return tuple(event_of_row(row) for row in clip.rows("events"))
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
    sizes = {a.shape[1:3] for a in found.values()}
    if len(sizes) > 1:
        found.pop("flow", None)
        opened.notes.append("the flow has another size than the pictures and is left out")
    return Pictures(
        found.get("rgb"), found.get("mask"), found.get("depth"), found.get("flow"), opened.schedule.pairs[:, 0]
    )


def _replayed(motions: list[MotionLayer], seen: Pictures, schedule: Schedule) -> Pictures:
    """The answer as the camera sees it, at the size of the clip's pictures."""
    motion = motions[-1]
    width, height = seen.size or (240, 160)
    run = replay_trace(motion.scene, motion.trace, schedule, width, height)
    return Pictures(run.pictures("raycast"), run.masks)


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
