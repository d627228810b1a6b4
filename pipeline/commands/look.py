"""`dynamics view`: a clip of a shard, a scene or a recording, into the rerun viewer or a file."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.commands.replay import Replay, pictures, replay, run_scene, run_schedule
from pipeline.commands.scene_source import read_scene_source, with_camera
from pipeline.commands.shard_footage import footage, open_clip, shard_folder
from pipeline.errors import OutputError, SceneError, ShardError
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene, write_scene
from pipeline.shards.arrays import open_arrays
from pipeline.shards.output_errors import writing_to
from pipeline.shards.tables import CLIP_COLUMN, read_table
from pipeline.viewer import recording
from pipeline.viewer.footage import Footage, MotionLayer, Pictures

RECORDING = "recording.rrd"


def look(place: Path, clip: int | None, seconds: float, file: Path | None) -> None:
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
        return footage(open_clip(*shards, clip))
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
    trace = run_scene(scene, schedule)
    seen, note = with_camera(scene, trace.position)
    text = "\n".join([f"### {name}", "", *([f"- {note}"] if note else []), "", "```yaml", write_scene(scene), "```"])
    if seen.camera is None:
        return Footage(name, text, (MotionLayer("scene", seen, trace),), fps=schedule.fps)
    run = replay(seen, trace, schedule)
    motion = MotionLayer("scene", seen, trace, True, run.events)
    return Footage(name, text, (motion,), _pictures(run, schedule), fps=schedule.fps)


def _pictures(run: Replay, schedule: Schedule) -> Pictures:
    first = schedule.pairs[:, 0]
    drawn = pictures(run.scene, run.trace, schedule, "raycast")
    return Pictures(drawn, run.masks, run.depth, first, run.flow, first)


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
    return Footage(f"{path.stem}/{clip}", f"### clip {clip} of `{path}`", (),
                   Pictures(read.get("rgb"), read.get("mask"), flow=flow, flow_frames=frames))  # fmt: skip


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
