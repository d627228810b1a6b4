"""`pipeline.export`: what a folder of results shows, as one web page that needs no server and no network."""

from __future__ import annotations

import os
import uuid
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.api.overlay import BETWEEN, outlined
from pipeline.api.result_folder import RESULT
from pipeline.api.saved_result import EditResult, InferResult, SimulateResult, read_result
from pipeline.api.scene_source import SCENE_FILE, with_camera
from pipeline.api.simulate import COLUMNS, EDITED, ORIGINAL
from pipeline.clips.replay import replay
from pipeline.clips.schedule import Schedule
from pipeline.editing.edit_list import Edit
from pipeline.editing.edited_motion import filmed_motion, run_edits
from pipeline.editing.filmed_clip import CLIP, read_clip
from pipeline.errors import OutputError, SceneError
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene, write_scene
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.shards.output_errors import writing_to
from pipeline.untrusted import read_table_bytes
from pipeline.viewer.page.film import Panel, film
from pipeline.viewer.page.motion_3d import RATE, BodyPath, motion_record, sampled_steps
from pipeline.viewer.page.result_page import ResultPage, Table, html
from pipeline.vision.recordings.video import read_clip as read_video
from pipeline.vision.rendering.render_backend import choose_backend

MOST_PAGE_BYTES = 8_000_000
TRANSPARENT = "In 3D, transparent bodies move as in the original scene."
PART_OF_THE_TIME = (
    "Bodies that were added or removed are shown in the clips; in 3D only where they are there all the time."
)


def export(found: str | Path) -> str:
    """The page of a folder of results, as HTML.

    Args:
        found: A folder that `dynamics infer`, `dynamics edit` or `dynamics simulate` wrote. That of `edit` needs the
            folder that was edited, too, where it was.

    Raises:
        OutputError: It is no such folder, or the page would be larger than MOST_PAGE_BYTES.
        SceneError, VideoError, SimulationError: One of its files cannot be used.
    """
    folder = Path(found)
    page = html(result_page(folder))
    if len(page.encode()) > MOST_PAGE_BYTES:
        raise OutputError(f"{folder}: the page would have {len(page.encode()):,} bytes; at most {MOST_PAGE_BYTES:,}")
    return page


def result_page(folder: Path) -> ResultPage:
    """What the page of a folder of results shows. Raises as `export`."""
    result = read_result(folder)
    if isinstance(result, InferResult):
        return _of_infer(folder, result)
    return _of_edit(folder, result) if isinstance(result, EditResult) else _of_simulate(folder, result)


def write_page(page: str, place: Path, force: bool = False) -> None:
    """Write a page. Raises OutputError where the file is there (without `force`) or cannot be written."""
    check_new_file(place, force)
    temporary = place.with_name(f".{place.name[:100]}.{uuid.uuid4().hex}.part")
    with writing_to(place):
        try:
            temporary.write_text(page, encoding="utf-8")
            os.replace(temporary, place)
        finally:
            with suppress(OSError):
                temporary.unlink()


def check_new_file(place: Path, force: bool) -> None:
    """Raise OutputError where `place` is in the way, or lies in no folder."""
    if place.is_dir():
        raise OutputError(f"{place} is a folder; valid: the name of a file, as page.html")
    if not place.parent.is_dir():
        raise OutputError(f"{place.parent}: there is no such folder")
    if place.exists() and not force:
        raise OutputError(f"{place} exists already: choose another name, or give --force to replace it")


def paths_of(scene: Scene, trace: Trace, ghost: bool = False) -> list[BodyPath]:
    """The motion of a scene's objects, RATE poses a second."""
    steps = sampled_steps(len(trace.position) - 1, trace.rate)
    return [
        BodyPath(o, i, trace.position[steps, i], trace.quaternion[steps, i], ghost) for i, o in enumerate(scene.objects)
    ]


def _of_infer(folder: Path, result: InferResult) -> ResultPage:
    clip, scene = read_clip(folder / CLIP), load_scene(folder / SCENE_FILE)
    height, width = clip.masks.shape[1:]
    run = replay(scene, clip.schedule, width, height)
    backend, _ = choose_backend("auto")
    outlines = np.stack([outlined(f, m, (width, height)) for f, m in zip(clip.frames, run.masks, strict=True)])
    panels = [
        Panel("the clip", clip.frames),
        Panel("the replay", run.pictures(backend)),
        Panel("its outlines on the clip", outlines),
    ]
    assert run.trace is not None
    return ResultPage(
        title=f"{Path(result.clip).name}: {', '.join(o.name for o in scene.objects)}",
        grade=result.grade,
        reason=result.grade_reason,
        film=film(panels, clip.schedule.rate),
        motion=motion_record(scene, paths_of(scene, run.trace), RATE, width / height),
        scene=write_scene(scene),
        tables=[_methods(result), *_forecast(result), *_events(result)],
        notes=_notes(result),
    )


def _methods(result: InferResult) -> Table:
    rows = [
        (m.method, m.composition, _two(m.sequence_iou), _two(m.epe_frame_px), str(m.simulations))
        for m in result.methods
    ]
    header = ("method", "objects", "IoU", "flow error, px", "simulations")
    note = f"The scene is from: {result.answer.source}. IoU: overlap of the replay's and the clip's masks, at most 1."
    return Table("How well it fits", header, rows, note)


def _forecast(result: InferResult) -> list[Table]:
    known = result.forecast
    if known is None:
        return []
    rows = [
        ("a scene fitted to the frames before", _two(known.iou)),
        ("constant velocity", _two(known.constant_velocity_iou)),
    ]
    return [Table("Forecast", ("from", "IoU"), rows, f"Frames from {known.from_s:.2f} s on, which were not fitted.")]


def _events(result: InferResult) -> list[Table]:
    rows = [tuple(line.removeprefix("t=").split(": ", 1)) for line in result.answer.events_of_replay]
    return [Table("What happens in the replay", (), rows)] if rows else []


def _notes(result: InferResult) -> list[str]:
    weak = [c.place for c in result.certainty if not c.determined]
    notes = [f"Scale: {result.assumed.scale}.", f"View: {result.view.kind} ({result.view.reason})."]
    notes += [f"Doubt: {doubt}" for doubt in result.answer.doubts]
    return notes + ([f"Weakly determined by this clip: {', '.join(weak)}."] if weak else [])


def _of_edit(folder: Path, result: EditResult) -> ResultPage:
    source = Path(result.found)
    if not (source / CLIP).is_file():
        raise OutputError(f"{folder}: {source}, the folder that was edited, is needed as well, and it is not there")
    clip, scene = read_clip(source / CLIP), load_scene(source / SCENE_FILE)
    height, width = clip.masks.shape[1:]
    edited = _frames(folder / "edited.mp4")[: len(clip.frames), :height, :width]
    edits = _edits(folder, result)
    filmed, trace = filmed_motion(scene, clip.times)
    made = run_edits(scene, trace, edits, clip.times)
    moving = made.motion
    paths = [
        BodyPath(
            body,
            i if origin is None else origin,
            np.where(moving.shown[:, i, None], moving.position[:, i], np.nan),
            moving.quaternion[:, i],
        )
        for i, (body, origin) in enumerate(zip(moving.objects, made.origin, strict=True))
    ]
    ghosts = [BodyPath(o, i, filmed.position[:, i], filmed.quaternion[:, i], True) for i, o in enumerate(scene.objects)]
    shares = [(kind, f"{100 * share:.0f} %") for kind, share in result.pixels.items()]
    return ResultPage(
        title=f"{_clip_of(source)}, edited",
        grade="",
        reason="; ".join(str(e) for e in edits) or "nothing was changed",
        film=film([Panel("as filmed", clip.frames), Panel("edited", edited)], clip.schedule.rate),
        motion=motion_record(scene, [*paths, *ghosts], clip.schedule.rate, width / height),
        scene=(folder / SCENE_FILE).read_text(encoding="utf-8"),
        tables=[Table("Where the bodies' pixels are from", (), shares)],
        notes=["In 3D, transparent bodies move as in the clip."],
    )


def _clip_of(folder: Path) -> str:
    """The name of the clip that `dynamics infer` was given. Raises OutputError."""
    result = read_result(folder)
    return Path(result.clip).name if isinstance(result, InferResult) else folder.name


def _edits(folder: Path, result: EditResult | SimulateResult) -> list[Edit]:
    try:
        return [Edit(**e) for e in result.edits]
    except TypeError as error:
        raise OutputError(f"{folder / RESULT}: edits: {error}; run `dynamics {result.command}` again") from None


def _of_simulate(folder: Path, result: SimulateResult) -> ResultPage:
    scene, seconds = load_scene(folder / SCENE_FILE), result.seconds
    edits = _edits(folder, result)
    runs = _trajectory(folder / "trajectory.csv", scene)
    scene, _ = with_camera(scene, np.concatenate([place for run in runs.values() for place, _ in run.values()]))
    both = _frames(folder / "replay.mp4")[: round(seconds * Schedule().fps)]
    half = (both.shape[2] - BETWEEN) // 2
    paths = []
    for name, run in runs.items():
        for i, (position, quaternion) in run.items():
            steps = sampled_steps(len(position) - 1, STEPS_PER_SECOND)
            paths.append(BodyPath(scene.objects[i], i, position[steps], quaternion[steps], name == ORIGINAL))
    rows = [(d.name, f"{d.end:.3f} m", f"{d.largest:.3f} m", f"{d.time:.2f} s") for d in result.departures]
    return ResultPage(
        title=f"{Path(result.scene).name}, simulated",
        grade="",
        reason="; ".join(str(e) for e in edits) or "nothing was changed",
        film=film([Panel("original", both[:, :, :half]), Panel("edited", both[:, :, -half:])], Schedule().fps),
        motion=motion_record(scene, paths, RATE, half / both.shape[1]),
        scene=write_scene(scene),
        tables=[Table("How far the edited motion departs", ("object", "at the end", "at most", "at"), rows)],
        notes=[TRANSPARENT, *([PART_OF_THE_TIME] if any(e.set is None for e in edits) else []), *result.notes],
    )


def _frames(path: Path) -> np.ndarray:
    """(T, H, W, 3) The frames of a video of ours, in its own size."""
    return read_video(path, seconds=None).frames


def _trajectory(path: Path, scene: Scene) -> dict[str, dict[int, tuple[np.ndarray, np.ndarray]]]:
    """Of both runs, each object that is there all the time: its index, positions (S, 3) and quaternions (S, 4)."""
    try:
        table = pd.read_csv(read_table_bytes(path, SceneError), usecols=list(COLUMNS))
        samples = table["time"].nunique()
        runs: dict[str, dict[int, tuple[np.ndarray, np.ndarray]]] = {EDITED: {}, ORIGINAL: {}}
        for name, run in runs.items():
            for i, o in enumerate(scene.objects):
                own = table[(table["clip"] == name) & (table["object"] == o.name)]
                if len(own) == samples:
                    place, turn = (own[list(keys)].to_numpy(float) for keys in ("xyz", ("qw", "qx", "qy", "qz")))
                    run[i] = place, turn
    except ValueError as error:
        raise SceneError(f"{path} is no trajectory of `dynamics simulate`: {error}") from None
    if not any(runs.values()):
        raise SceneError(f"{path} has no object of {SCENE_FILE} that is there all the time")
    return runs


def _two(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
