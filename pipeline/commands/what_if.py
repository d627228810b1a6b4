"""What if: a scene and its edited copy, run beside each other."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.commands.lettering import side_by_side
from pipeline.commands.progress import Progress
from pipeline.commands.replay import pictures, replay, run_scene, run_schedule
from pipeline.commands.result_folder import check_replaceable, result_folder, write_result
from pipeline.commands.scene_edits import edited
from pipeline.commands.scene_source import SCENE_FILE, read_scene_source, with_camera
from pipeline.commands.table import Row, aligned, markdown
from pipeline.errors import SceneError
from pipeline.physics.trace import Trace
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import write_scene
from pipeline.viewer.footage import Footage, MotionLayer, Pictures
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.render_backend import choose_backend

ORIGINAL, EDITED = "original", "edited"
#: The columns of measured motion (docs/formats.md), and the velocity.
COLUMNS = ("clip", "object", "time", "x", "y", "z", "qw", "qx", "qy", "qz", "wx", "wy", "wz", "vx", "vy", "vz")


@dataclass(frozen=True)
class Departure:
    """How an object's edited motion departs from its original one: end and largest distance, m; when the largest, s."""

    name: str
    shape: str
    end: float
    largest: float
    time: float


def what_if(place: Path, edits: Sequence[str], seconds: float, out: Path | None, force: bool) -> None:
    """Run the scene at `place` and its edited copy, print how far apart they end, and write `out` where it is given.

    Raises DynamicsError; nothing is written then.
    """
    schedule = run_schedule(seconds)
    if out is not None:
        check_replaceable(out, force)
    before = read_scene_source(place)
    if not before.objects:
        raise SceneError(f"{place}: objects: there are none to simulate")
    after = edited(before, edits)
    traces = run_scene(before, schedule), run_scene(after, schedule)
    for line in aligned(table(departures(after, *traces), traces)):
        print(line)
    if not edits:
        print("note: nothing was changed; give --set, as --set objects[0].mass=2")
    if out is None:
        return
    with result_folder(out, force) as folder, Progress(1) as progress:
        with progress.step("pictures"):
            notes = _write(folder, place, before, after, traces, schedule)
        for note in notes:
            progress.say("note", note)
        result = {
            "scene": str(place),
            "set": list(edits),
            "seconds": seconds,
            "notes": notes,
            "departures": [vars(d) for d in departures(after, *traces)],
            "versions": {name: version(name) for name in ("dynamics-pipeline", "mujoco", "numpy")},
        }
        write_result(folder, "simulate", result)
    print(f"written    {out}: replay.mp4 shows both")


def departures(scene: Scene, original: Trace, changed: Trace) -> list[Departure]:
    """One for each object, in order."""
    apart = np.linalg.norm(changed.position - original.position, axis=-1)  # (S + 1, N)
    steps = apart.argmax(0)
    return [
        Departure(o.name, o.shape, float(apart[-1, i]), float(apart[steps[i], i]), float(original.times[steps[i]]))
        for i, o in enumerate(scene.objects)
    ]


def table(rows: Sequence[Departure], traces: tuple[Trace, Trace]) -> list[Row]:
    """Cells, a heading first."""
    cells: list[Row] = [("object", "shape", "ends apart", "most apart", "at", "original end", "edited end")]
    for i, d in enumerate(rows):
        ends = ("({:.2f}, {:.2f}, {:.2f}) m".format(*t.position[-1, i]) for t in traces)
        cells.append((d.name, d.shape, f"{d.end:.3f} m", f"{d.largest:.3f} m", f"{d.time:.2f} s", *ends))
    return cells


def _write(
    folder: Path, place: Path, before: Scene, after: Scene, traces: tuple[Trace, Trace], schedule: Schedule
) -> list[str]:
    """The files beside result.json; notes on what was assumed."""
    (folder / SCENE_FILE).write_text(write_scene(after), encoding="utf-8")
    (folder / "scene.xml").write_text(scene_xml(after), encoding="utf-8")
    write_trajectory(folder / "trajectory.csv", ((ORIGINAL, before, traces[0]), (EDITED, after, traces[1])))
    made, note = with_camera(after, np.concatenate([t.position for t in traces]))
    shown_before = before if before.camera is not None else made
    seen = [_looked_at(scene, camera) for scene, camera in ((before, shown_before), (after, made))]
    backend, reason = choose_backend("auto")
    frames = [pictures(s, t, schedule, backend) for s, t in zip(seen, traces, strict=True)]
    write_video(folder / "replay.mp4", side_by_side(frames[0], frames[1], (ORIGINAL, EDITED)), schedule.fps)
    runs = [replay(s, t, schedule) for s, t in zip(seen, traces, strict=True)]
    shown = [Pictures(f, r.masks) for f, r in zip(frames, runs, strict=True)]
    motions = (MotionLayer(EDITED, seen[1], traces[1], True, runs[1].events),
               MotionLayer(ORIGINAL, seen[0], traces[0], False, runs[0].events))  # fmt: skip
    lines = markdown(table(departures(after, *traces), traces))
    notes = [*([note] if note else []), f"pictures by {reason}"]
    text = "\n".join(["### What if", "", *lines, "", *(f"- {n}" for n in notes)])
    name = f"{place.stem if place.name != SCENE_FILE else place.resolve().parent.name}, edited"
    save(Footage(name, text, motions, shown[1], shown[0], schedule.fps, (EDITED, ORIGINAL)), folder / "recording.rrd")
    return notes


def _looked_at(scene: Scene, by: Scene) -> Scene:
    return Scene(scene.objects, by.camera, scene.gravity, scene.ground, scene.effects)


def write_trajectory(path: Path, runs: Sequence[tuple[str, Scene, Trace]]) -> None:
    """Every state of every run as CSV: measured motion (docs/formats.md), `clip` being the run, and the velocity."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(COLUMNS)
        for name, scene, trace in runs:
            values: Any = np.concatenate(
                [trace.position, trace.quaternion, trace.angular_velocity, trace.velocity], axis=-1
            )
            for i, obj in enumerate(scene.objects):
                for step, time in enumerate(trace.times):
                    out.writerow((name, obj.name, f"{time:.6f}", *(f"{v:.6g}" for v in values[step, i])))
