"""The files that `Inference.save` and `dynamics infer` write."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from PIL import Image

from pipeline.api.inference import Inference
from pipeline.api.mask_sheet import SHEET, write_sheet
from pipeline.api.motion_figure import write_motion_figure
from pipeline.api.overlay import Row, Sheet, draw, side_by_side
from pipeline.api.result_folder import write_result
from pipeline.clips.replay import Replay
from pipeline.editing.filmed_clip import CLIP, FilmedClip, write_clip
from pipeline.inference.body_tracks import body_tracks, clip_track, objects_of, track_table
from pipeline.inference.method import TRACKS, Method
from pipeline.inference.progress import Progress
from pipeline.model.language.completion import think_text
from pipeline.report.markdown import markdown
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.text import write_scene
from pipeline.shards.content_hash import hash_path
from pipeline.viewer.footage import Footage, MotionLayer, Pictures, event_text
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.render_backend import choose_backend
from pipeline.worlds.plane import FOV_DEG

_VERSIONS = ("dynamics-pipeline", "mujoco", "numpy", "opencv-python-headless", "rerun-sdk", "torch", "transformers")
SCALE = {
    "none": "nothing tells how large things are: lengths are relative; masses of bodies that hit nothing movable are "
    "guesses",
    "gravity": "gravity fixes it: the acceleration of what falls or rolls",
    "length": "the length that was given",
    "size": "the size that was given",
    "board": "the board that was given",
}
TABLE_CAMERA = "at rest, at (0, -2, h) m, looking along +y; square pixels, no distortion"
PLANAR_CAMERA = (
    f"at rest, {FOV_DEG:g} degrees along its longer side; it looks straight at the plane of motion, "
    "but for view.pitch_deg and view.yaw_deg"
)


def write_files(folder: Path, found: Inference, progress: Progress) -> None:
    """Write everything into a folder, result.json last."""
    run = found.replay()
    if not (folder / SHEET).exists():  # the command shows it before the search
        write_sheet(folder, found.name, found.clip.taken)
    masks = relabelled(found.clip.taken.masks, found.best.overlap.pairs, len(run.scene.objects))
    with progress.step("pictures"), ThreadPoolExecutor(2, "files") as beside:
        others: list[Future[Any]] = [
            beside.submit(lambda: found.scenes.forecast),
            beside.submit(_write_motion, folder, found, run),
            beside.submit(_write_scene, folder, found, run, masks),
        ]
        renderer = _write_pictures(folder, found, run, masks)
        for other in others:
            other.result()
    progress.say("pictures", f"of the replay: {renderer}")
    write_result(folder, "infer", _result(found, run, renderer, found.seconds | progress.seconds))


def method_table(methods: tuple[Method, ...]) -> list[Row]:
    """Cells, a heading first."""
    rows: list[Row] = [("method", "objects", "IoU", "reward", "flow error", "simulations")]
    for m in methods:
        numbers = (f"{m.overlap.sequence:.2f}", f"{m.reward:.2f}", f"{m.epe_frame:.2f} px", str(m.simulations))
        rows.append((m.name, m.scene.composition, *numbers))
    return rows


def relabelled(masks: np.ndarray, pairs: np.ndarray, objects: int) -> np.ndarray:
    """The clip's masks with each instance's id that of the object it is paired with; others come after the objects'."""
    table = np.zeros(256, np.uint8)
    table[pairs[:, 1] + 1] = pairs[:, 0] + 1
    alone = [j for j in range(1, int(masks.max(initial=0)) + 1) if not table[j]]
    for k, j in enumerate(alone):
        table[j] = min(objects + 1 + k, 255)
    return table[masks]


def _write_scene(folder: Path, found: Inference, run: Replay, masks: np.ndarray) -> None:
    """Write the scene, and the clip with masks (T, H, W) whose ids are those of the scene's objects."""
    (folder / "scene.yaml").write_text(write_scene(run.scene), encoding="utf-8")
    (folder / "scene.xml").write_text(scene_xml(run.scene), encoding="utf-8")
    write_clip(folder / CLIP, FilmedClip(found.clip.taken.clip.frames, masks, found.clip.schedule.times))


def _write_pictures(folder: Path, found: Inference, run: Replay, masks: np.ndarray) -> str:
    """Write the replay, overlay.png and recording.rrd; returns which renderer made the pictures.

    masks: (T, H, W) of the clip, whose ids are those of the scene's objects.
    """
    clip, best = found.clip, found.best
    backend, reason = choose_backend("auto")
    drawn = run.pictures(backend)
    frames, first, times = clip.taken.clip.frames, clip.schedule.pairs[:, 0], clip.schedule.times
    write_video(folder / "replay.mp4", side_by_side(frames, drawn, ("input", "replay")), times)
    place, rows = Path(found.name), method_table(found.methods)
    title = f"{place.name}: {best.scene.composition} ({best.name})"
    sheet = Sheet(
        frames=first,
        times=clip.taken.clip.source_times,
        rgb=frames,
        replay_rgb=drawn,
        masks=masks,
        replay_masks=run.masks,
        flow=clip.flow,
        replay_flow=run.flow,
        names=tuple(o.name for o in run.scene.objects),
        title=title,
        rows=tuple(rows),
    )
    Image.fromarray(draw(sheet)).save(folder / "overlay.png")
    seen = Pictures(frames, masks, flow=clip.flow, frames=first)
    replayed = Pictures(drawn, run.masks, run.depth, run.flow, first)
    notes = "\n".join(
        [
            f"### {title}",
            "",
            markdown(rows[0], rows[1:]),
            *(f"- {n}" for n in (*clip.notes, *found.doubts)),
            "",
            "**In words**",
            "",
            *words_of(found, run).splitlines(),
        ]
    )
    assert run.trace is not None
    motion = MotionLayer("replay", run.scene, run.trace, True, run.events)
    save(
        Footage(name=place.stem, notes=notes, motions=(motion,), seen=seen, replayed=replayed, times=times),
        folder / "recording.rrd",
    )
    return reason


def _result(found: Inference, run: Replay, renderer: str, seconds: dict[str, float]) -> dict[str, Any]:
    """The content of result.json."""
    taken, settings, best, base = found.clip.taken.clip, found.settings, found.best, found.base
    sampling, shown = found.scenes.sampling, found.base.input
    assert shown is not None
    search = None if found.scenes.searched is None else found.scenes.searched.result
    motion, view, ahead = found.scenes.filmed.motion, found.scenes.view, found.scenes.forecast
    turn = motion.plane.tilt
    return {
        "clip": found.name,
        "grade": found.grade.name,
        "grade_reason": found.grade.reason,
        "metric": {"by": found.metric, "error": _number(np.nan if found.scale is None else found.scale.error)},
        "forecast": None
        if ahead is None
        else {
            "from_s": round(ahead.from_s, 4),
            "iou": _number(ahead.iou),
            "constant_velocity_iou": _number(ahead.constant_velocity_iou),
        },
        "view": {
            "kind": view.kind,
            "reason": view.reason,
            "slope_deg": _number(view.slope_deg),
            "roll_deg": _number(view.roll_deg),
            "pitch_deg": 0.0 if turn is None else _number(-np.degrees(turn.pitch)),
            "yaw_deg": 0.0 if turn is None else _number(np.degrees(turn.yaw)),
            "gravity_px_per_s2": None if view.gravity_px is None else [_number(v) for v in view.gravity_px],
            "px_per_m": _number(found.scenes.filmed.answer.scale.px_per_m) if found.scenes.filmed.answer else None,
        },
        "joints": found.joints,
        "assumed": {
            "start_s": round(float(taken.source_times[0]), 4),
            "start_from": "the motion" if settings.start is None else "--start",
            "seconds": round(found.clip.schedule.seconds, 4),
            "recorded_fps": round(taken.source_fps, 4),
            "fps_from": "the file" if settings.fps is None else "--fps",
            "frames": found.clip.schedule.frames,
            "used_fps": round(found.clip.schedule.rate, 4),
            "source_size_px": list(taken.source_size),
            "size_px": list(taken.letterbox.size),
            "masks_from": found.clip.taken.masks_from,
            "instances": found.clip.objects,
            "prompts": settings.prompts.record(),
            "camera": PLANAR_CAMERA if best.name == TRACKS else TABLE_CAMERA,
            "incline": settings.search.incline,
            "gravity": settings.world.gravity,
            "scale": SCALE[found.metric],
            "notes": list(found.clip.notes),
        },
        "flow": {
            "by": settings.flow.name,
            "weights": str(settings.flow.raft) if settings.flow.name == "raft" else None,
            "size_px": list(found.flow_size),
        },
        "model": {
            "name": base.name,
            "sha256": hash_path(Path(base.name)) if Path(base.name).is_dir() else None,
            "shown": shown.input,
            "picture": shown.picture,
            "reasoning": sampling.reasoning,
            "samples": sampling.samples,
            "temperature": sampling.temperature,
            "top_p": sampling.top_p,
            "middle": sampling.middle,
            "seed": settings.question.seed,
        },
        "answer": {
            "from": best.name,
            "composition": best.scene.composition,
            "think": words_of(found, run),
            "events_of_replay": [f"t={e.time:.2f}s: {event_text(e, run.scene)}" for e in run.events],
            "doubts": found.doubts,
        },
        "methods": [
            {
                "method": m.name,
                "composition": m.scene.composition,
                "reward": _number(m.reward),
                "iou": _number(m.iou),
                "epe_frame_px": _number(m.epe_frame),
                "sequence_iou": _number(m.overlap.sequence),
                "initial_iou": _number(m.overlap.initial),
                "foreground_iou": _number(m.overlap.foreground),
                "sample": None if m.answer is None else m.answer.sample,
                "simulations": m.simulations,
            }
            for m in found.methods
        ],
        "samples": [
            {
                "sample": a.sample,
                "composition": a.scene.composition,
                "reward": _number(found.scenes.rewards.reward[i]),
                "log_probability": _number(a.log_probability),
            }
            for i, a in enumerate(found.scenes.answers)
        ],
        "search": None
        if search is None
        else {
            "simulations": search.simulations,
            "invalid": search.invalid,
            "seconds": round(search.seconds, 2),
            "spent": search.spent.tolist(),
            "history": [_number(v) for v in search.history],
        },
        "shapes": []
        if found.scenes.searched is None
        else [
            {"object": obj.name, "probability": {s: round(p, 4) for s, p in probability.items()}}
            for obj, probability in zip(
                found.scenes.searched.result.scene.objects, found.scenes.searched.shapes, strict=True
            )
            if probability
        ],
        "certainty": [
            {
                "place": c.place,
                "value": _number(c.value),
                "spread": _number(c.spread),
                "unit": c.unit,
                "determined": c.determined,
            }
            for c in found.scenes.certainties
        ],
        "renderer": renderer,
        "seconds": seconds,
        "versions": {name: version(name) for name in _VERSIONS},
    }


def words_of(found: Inference, run: Replay) -> str:
    """What happens, in words: the model's, or of the replay's events where no answer belongs to the scene."""
    answer = found.best.answer
    return think_text(run.scene, list(run.events), run.schedule.seconds) if answer is None else answer.completion.think


def _write_motion(folder: Path, found: Inference, run: Replay) -> None:
    """Write tracks.parquet and motion.png: the measured motion of the bodies in the scene's metres."""
    filmed, clip = found.scenes.filmed, found.clip.taken
    width, height = clip.clip.letterbox.size
    tracks = list(filmed.motion.tracks)
    if clip.found is not None:
        tracks = [clip_track(t, clip.clip.letterbox) for t in tracks]
    objects = objects_of(found.best.overlap.pairs, found.best.name == TRACKS, tracks)
    measured = body_tracks(run.scene, objects, width, height)
    pq.write_table(track_table(Path(found.name).stem, measured), folder / "tracks.parquet")
    write_motion_figure(folder / "motion.png", measured, run.scene, found.metric)


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
