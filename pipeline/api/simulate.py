"""`pipeline.simulate`: a scene and its edited copy, run beside each other."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.api.overlay import Row, side_by_side
from pipeline.api.result_folder import FolderResult, write_result
from pipeline.api.scene_source import SCENE_FILE, read_scene_source, with_camera
from pipeline.clips.replay import replay_trace
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import HEIGHT, WIDTH, rendering_of
from pipeline.editing.edit_list import Edit, in_order
from pipeline.editing.edited_motion import Run, edited_runs
from pipeline.errors import SceneError
from pipeline.inference.progress import Progress
from pipeline.physics.simulate import simulate as run_scene
from pipeline.physics.trace import Trace
from pipeline.report.markdown import markdown
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import save_scene
from pipeline.viewer.footage import Footage, MotionLayer, Pictures
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_rgb
from pipeline.vision.rendering.render_backend import choose_backend

ORIGINAL, EDITED = "original", "edited"
#: The columns of measured motion (docs/formats.md), and the velocity.
COLUMNS = ("clip", "object", "time", "x", "y", "z", "qw", "qx", "qy", "qz", "wx", "wy", "wz", "vx", "vy", "vz")


@dataclass(frozen=True)
class Departure:
    """How an object's edited motion departs from its original one.

    Attributes:
        name: Of the object.
        shape: Of the object.
        end: Distance at the end, m.
        largest: Largest distance, m.
        time: When that was, s.
    """

    name: str
    shape: str
    end: float
    largest: float
    time: float


@dataclass(frozen=True)
class Simulation(FolderResult):
    """Two runs of a scene, as it is and edited.

    Attributes:
        name: Where the scene is from.
        edits: By time.
        original: The scene.
        schedule: Which moments are frames.
        original_trace: States and contacts of the original, 240 a second.
        runs: Those of the edited scene, from one edit to the next.
    """

    name: str
    edits: tuple[Edit, ...]
    original: Scene
    schedule: Schedule
    original_trace: Trace
    runs: tuple[Run, ...]

    @property
    def scene(self) -> Scene:
        """The scene after the last edit, with its state at that time."""
        return self.runs[-1].scene

    @property
    def trace(self) -> Trace:
        """The motion from the last edit on."""
        return self.runs[-1].trace

    @cached_property
    def departures(self) -> list[Departure]:
        """One for each object that both have at the end, in order."""
        out, times = [], self.original_trace.times
        for i, o in enumerate(self.original.objects):
            path = self._path(o.name)
            if np.isfinite(path[-1]).all():
                apart = np.linalg.norm(path - self.original_trace.position[:, i], axis=-1)  # (S + 1,), NaN where absent
                most = int(np.nanargmax(apart))
                out.append(Departure(o.name, o.shape, float(apart[-1]), float(apart[most]), float(times[most])))
        return out

    def table(self) -> list[Row]:
        """The departures as cells, a heading first."""
        cells: list[Row] = [("object", "shape", "ends apart", "most apart", "at", "original end", "edited end")]
        departures = {d.name: d for d in self.departures}
        originals = {o.name: i for i, o in enumerate(self.original.objects)}
        for o in {o.name: o for o in (*self.original.objects, *self.scene.objects)}.values():
            d, i = departures.get(o.name), originals.get(o.name)
            before = "" if i is None else _place(self.original_trace.position[-1, i])
            after = _place(self._path(o.name)[-1])
            if d is None:
                cells.append((o.name, o.shape, "added" if i is None else "removed", "", "", before, after))
            else:
                apart = f"{d.end:.3f} m", f"{d.largest:.3f} m", f"{d.time:.2f} s"
                cells.append((o.name, o.shape, *apart, before, after))
        return cells

    def write(self, folder: Path, progress: Progress) -> None:
        """Write scene.yaml, scene.xml, replay.mp4, trajectory.csv, recording.rrd and result.json."""
        with progress.step("pictures"):
            notes = _write(folder, self)
        for note in notes:
            progress.say("note", note)
        write_result(
            folder,
            "simulate",
            {
                "scene": self.name,
                "edits": [edit.record() for edit in self.edits],
                "seconds": self.schedule.seconds,
                "notes": notes,
                "departures": [vars(d) for d in self.departures],
                "versions": {name: version(name) for name in ("dynamics-pipeline", "mujoco", "numpy")},
            },
        )

    def _path(self, name: str) -> np.ndarray:
        """(S + 1, 3) m, where the edited object of a name is; NaN while there is none."""
        out = np.full((len(self.original_trace.position), 3), np.nan)
        for run in self.runs:
            out[run.step :] = np.nan
            for k, o in enumerate(run.scene.objects):
                if o.name == name:
                    out[run.step :] = run.trace.position[: len(out) - run.step, k]
        return out


def simulate(scene: str | Path | Scene, seconds: float = 1.0, edits: Sequence[str | Edit] = ()) -> Simulation:
    """Run a scene as it is and with changes.

    Args:
        scene: A scene file, a model's answer, a folder that `dynamics` wrote, or a scene.
        seconds: How long to run.
        edits: Changes from the beginning on, as "objects[0].mass=2" or "gravity=1.6", objects by index or by name; or
            edits with a time (`pipeline.editing.edit_list`).

    Returns:
        Both scenes with their traces, and how far apart the objects end.

    Raises:
        SceneError: For a scene without objects, or an edit that does not fit it.
        SimulationError: Where the simulation becomes unstable.
    """
    schedule = run_schedule(seconds)
    name = "scene" if isinstance(scene, Scene) else str(scene)
    before = scene if isinstance(scene, Scene) else read_scene_source(Path(scene))
    if not before.objects:
        raise SceneError(f"{name}: objects: there are none to simulate")
    listed = [Edit(0.0, set=edit) if isinstance(edit, str) else edit for edit in edits]
    ordered = in_order(listed, schedule.seconds, "the run")
    trace = run_scene(before, schedule.seconds)
    runs, _ = edited_runs(before, trace, ordered)
    return Simulation(
        name=name,
        edits=tuple(ordered),
        original=before,
        schedule=schedule,
        original_trace=trace,
        runs=runs,
    )


def run_schedule(seconds: float) -> Schedule:
    """The frames of a run of any length. Raises SceneError where there are fewer than two."""
    usual = Schedule()
    frames = round(seconds * usual.fps)
    if frames < 2:
        raise SceneError(f"{seconds:g} s are less than two frames; valid: at least {2 / usual.fps:.3f} s")
    return Schedule(seconds=seconds, model_frames=min(usual.model_frames, frames - 1))


def write_trajectory(path: Path, runs: Sequence[tuple[str, Sequence[Run]]]) -> None:
    """Every state of every motion as CSV: measured motion (docs/formats.md), `clip` being its name, and the velocity.

    A motion is one run, or several, each of which ends where the next begins.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(COLUMNS)
        for name, parts in runs:
            ends = [part.step for part in parts[1:]] + [parts[-1].step + len(parts[-1].trace.position)]
            for obj_name in dict.fromkeys(o.name for part in parts for o in part.scene.objects):
                for part, end in zip(parts, ends, strict=True):
                    index = next((i for i, o in enumerate(part.scene.objects) if o.name == obj_name), None)
                    if index is None:
                        continue
                    t = part.trace
                    states: Any = (t.position, t.quaternion, t.angular_velocity, t.velocity)
                    values: Any = np.concatenate([v[: end - part.step, index] for v in states], axis=-1)
                    for step, row in enumerate(values, start=part.step):
                        out.writerow((name, obj_name, f"{step / t.rate:.6f}", *(f"{v:.6g}" for v in row)))


def _place(position: np.ndarray) -> str:
    return "({:.2f}, {:.2f}, {:.2f}) m".format(*position) if np.isfinite(position).all() else ""


def _write(folder: Path, run: Simulation) -> list[str]:
    """The files beside result.json; notes on what was assumed."""
    before, schedule = run.original, run.schedule
    save_scene(run.scene, folder / SCENE_FILE)
    (folder / "scene.xml").write_text(scene_xml(run.scene), encoding="utf-8")
    originals = (Run(0, before, run.original_trace),)
    write_trajectory(folder / "trajectory.csv", ((ORIGINAL, originals), (EDITED, run.runs)))
    places = [r.trace.position.reshape(-1, 3) for r in (*originals, *run.runs)]
    made, note = with_camera(before, np.concatenate(places))
    backend, reason = choose_backend("auto")
    names = list(dict.fromkeys(o.name for r in (*originals, *run.runs) for o in r.scene.objects))
    shown = [_drawn(runs, schedule, names, made, backend) for runs in (originals, run.runs)]
    both = [pictures.rgb for pictures in shown if pictures.rgb is not None]
    write_video(folder / "replay.mp4", side_by_side(both[0], both[1], (ORIGINAL, EDITED)), schedule.fps)
    notes = [*([note] if note else []), f"pictures by {reason}"]
    if len(run.runs) > 1:
        notes.append("the 3D view of recording.rrd shows the bodies from the last edit on")
    head, *rows = run.table()
    text = "\n".join(["### What if", "", markdown(head, rows), *(f"- {n}" for n in notes)])
    place = Path(run.name)
    name = f"{place.stem if place.name != SCENE_FILE else place.resolve().parent.name}, edited"
    motions = [
        _layer(EDITED, run.runs[-1], made, schedule, True),
        _layer(ORIGINAL, originals[0], made, schedule, False),
    ]
    save(
        Footage(
            name=name,
            notes=text,
            motions=tuple(motions),
            seen=shown[1],
            replayed=shown[0],
            times=schedule.times,
            titles=(EDITED, ORIGINAL),
        ),
        folder / "recording.rrd",
    )
    return notes


def _drawn(runs: Sequence[Run], schedule: Schedule, names: Sequence[str], camera: Scene, backend: str) -> Pictures:
    """Pictures and masks of a motion that consists of runs; an object's colour and id are its place among names."""
    steps = schedule.frame_steps
    ends = [run.step for run in runs[1:]] + [int(steps[-1]) + 1]
    plain = plain_appearance(len(names), len(camera.fixed))
    frames, masks = [], []
    for run, end in zip(runs, ends, strict=True):
        own = steps[(steps >= run.step) & (steps < end)] - run.step
        if not len(own):
            continue
        scene = run.scene if run.scene.camera is not None else replace(run.scene, camera=camera.camera)
        index = [names.index(o.name) for o in scene.objects]
        look = replace(plain_appearance(0, len(scene.fixed)), materials=tuple(plain.materials[i] for i in index))
        poses = run.trace.position[own], run.trace.quaternion[own]
        frames.append(render_rgb(scene, *poses, look, WIDTH, HEIGHT, backend))
        masks.append(np.array([0, *(i + 1 for i in index)], np.uint8)[rendering_of(scene, *poses, WIDTH, HEIGHT).mask])
    return Pictures(np.concatenate(frames), np.concatenate(masks))


def _layer(name: str, run: Run, camera: Scene, schedule: Schedule, solid: bool) -> MotionLayer:
    """A run in the viewer, with its events where it is the whole motion."""
    scene = run.scene if run.scene.camera is not None else replace(run.scene, camera=camera.camera)
    events = replay_trace(scene, run.trace, schedule).events if run.step == 0 and scene.objects else ()
    return MotionLayer(name, scene, run.trace, solid, events)
