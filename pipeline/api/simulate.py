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

from pipeline.api.overlay import Row, markdown, side_by_side
from pipeline.api.result_folder import result_folder, write_result
from pipeline.api.scene_source import SCENE_FILE, read_scene_source, with_camera
from pipeline.clips.replay import replay_trace
from pipeline.clips.schedule import Schedule
from pipeline.errors import SceneError
from pipeline.inference.progress import Progress
from pipeline.physics.simulate import simulate as run_scene
from pipeline.physics.trace import Trace
from pipeline.scene.edited import edited
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import save_scene
from pipeline.viewer.footage import Footage, MotionLayer, Pictures
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video
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
class Simulation:
    """Two runs of a scene, as it is and edited.

    Attributes:
        name: Where the scene is from.
        edits: As they were given.
        original: The scene.
        scene: The edited scene.
        schedule: Which moments are frames.
        original_trace: States and contacts of the original, 240 a second.
        trace: Those of the edited scene.
    """

    name: str
    edits: tuple[str, ...]
    original: Scene
    scene: Scene
    schedule: Schedule
    original_trace: Trace
    trace: Trace

    @cached_property
    def departures(self) -> list[Departure]:
        """One for each object, in order."""
        apart = np.linalg.norm(self.trace.position - self.original_trace.position, axis=-1)  # (S + 1, N)
        steps = apart.argmax(0)
        return [
            Departure(
                o.name, o.shape, float(apart[-1, i]), float(apart[steps[i], i]), float(self.trace.times[steps[i]])
            )
            for i, o in enumerate(self.scene.objects)
        ]

    def table(self) -> list[Row]:
        """The departures as cells, a heading first."""
        cells: list[Row] = [("object", "shape", "ends apart", "most apart", "at", "original end", "edited end")]
        for i, d in enumerate(self.departures):
            traces = (self.original_trace, self.trace)
            ends = ("({:.2f}, {:.2f}, {:.2f}) m".format(*t.position[-1, i]) for t in traces)
            cells.append((d.name, d.shape, f"{d.end:.3f} m", f"{d.largest:.3f} m", f"{d.time:.2f} s", *ends))
        return cells

    def save(self, out: str | Path, force: bool = False, progress: Progress | None = None) -> None:
        """Write a folder with scene.yaml, scene.xml, replay.mp4, trajectory.csv, recording.rrd and result.json.

        Args:
            out: The folder, which must not exist yet.
            force: Replace it where `dynamics` wrote it and nothing else is in it.
            progress: Told of the pictures.

        Raises:
            OutputError: Where it cannot be written; nothing is left then.
        """
        progress = progress or Progress()
        with result_folder(Path(out), force) as folder:
            with progress.step("pictures"):
                notes = _write(folder, self)
            for note in notes:
                progress.say("note", note)
            write_result(
                folder,
                "simulate",
                {
                    "scene": self.name,
                    "set": list(self.edits),
                    "seconds": self.schedule.seconds,
                    "notes": notes,
                    "departures": [vars(d) for d in self.departures],
                    "versions": {name: version(name) for name in ("dynamics-pipeline", "mujoco", "numpy")},
                },
            )


def simulate(scene: str | Path | Scene, seconds: float = 1.0, edits: Sequence[str] = ()) -> Simulation:
    """Run a scene as it is and with changes.

    Args:
        scene: A scene file, a model's answer, a folder that `dynamics` wrote, or a scene.
        seconds: How long to run.
        edits: Changes in order, as "objects[0].mass=2" or "gravity=1.6"; objects go by index or by name.

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
    after = edited(before, edits)
    return Simulation(
        name=name,
        edits=tuple(edits),
        original=before,
        scene=after,
        schedule=schedule,
        original_trace=run_scene(before, schedule.seconds),
        trace=run_scene(after, schedule.seconds),
    )


def run_schedule(seconds: float) -> Schedule:
    """The frames of a run of any length. Raises SceneError where there are fewer than two."""
    usual = Schedule()
    frames = round(seconds * usual.fps)
    if frames < 2:
        raise SceneError(f"{seconds:g} s are less than two frames; valid: at least {2 / usual.fps:.3f} s")
    return Schedule(seconds=seconds, model_frames=min(usual.model_frames, frames - 1))


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


def _write(folder: Path, run: Simulation) -> list[str]:
    """The files beside result.json; notes on what was assumed."""
    before, after, schedule = run.original, run.scene, run.schedule
    save_scene(after, folder / SCENE_FILE)
    (folder / "scene.xml").write_text(scene_xml(after), encoding="utf-8")
    runs = ((ORIGINAL, before, run.original_trace), (EDITED, after, run.trace))
    write_trajectory(folder / "trajectory.csv", runs)
    made, note = with_camera(after, np.concatenate([run.original_trace.position, run.trace.position]))
    shown_before = before if before.camera is not None else replace(before, camera=made.camera)
    backend, reason = choose_backend("auto")
    original = replay_trace(shown_before, run.original_trace, schedule)
    changed = replay_trace(made, run.trace, schedule)
    frames = [r.pictures(backend) for r in (original, changed)]
    write_video(folder / "replay.mp4", side_by_side(frames[0], frames[1], (ORIGINAL, EDITED)), schedule.fps)
    shown = [Pictures(f, r.masks) for f, r in zip(frames, (original, changed), strict=True)]
    motions = (
        MotionLayer(EDITED, changed.scene, run.trace, True, changed.events),
        MotionLayer(ORIGINAL, original.scene, run.original_trace, False, original.events),
    )
    notes = [*([note] if note else []), f"pictures by {reason}"]
    text = "\n".join(["### What if", "", *markdown(run.table()), "", *(f"- {n}" for n in notes)])
    place = Path(run.name)
    name = f"{place.stem if place.name != SCENE_FILE else place.resolve().parent.name}, edited"
    save(
        Footage(
            name=name,
            notes=text,
            motions=motions,
            seen=shown[1],
            replayed=shown[0],
            fps=schedule.fps,
            titles=(EDITED, ORIGINAL),
        ),
        folder / "recording.rrd",
    )
    return notes
