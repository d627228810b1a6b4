"""`pipeline.edit`: a clip as it would have been filmed had its scene been another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.api.overlay import side_by_side
from pipeline.api.result_folder import FolderResult, write_result
from pipeline.api.scene_source import SCENE_FILE
from pipeline.editing.compose import EditedFrames, compose
from pipeline.editing.edit_list import Edit, in_order
from pipeline.editing.edited_motion import EditedMotion, filmed_motion, run_edits
from pipeline.editing.filmed_clip import CLIP, FilmedClip, read_clip
from pipeline.editing.layers import Layers, take_apart
from pipeline.editing.view import view_of
from pipeline.errors import SceneError
from pipeline.inference.progress import Progress
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene, write_scene
from pipeline.viewer.footage import Footage, Pictures
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video

ORIGINAL, EDITED = "original", "edited"
SEED = 0  # of the noise


@dataclass(frozen=True)
class EditedClip(FolderResult):
    """An edited clip.

    Attributes:
        name: The folder that it was made from.
        edits: By time.
        clip: As it was filmed.
        original: The scene that was found in it.
        layers: The clip taken apart.
        motion: The edited motion.
        pictures: The edited frames.
        seconds: The time that each step took.
    """

    name: str
    edits: tuple[Edit, ...]
    clip: FilmedClip
    original: Scene
    layers: Layers
    motion: EditedMotion
    pictures: EditedFrames
    seconds: dict[str, float]

    def write(self, folder: Path, progress: Progress) -> None:
        """Write edited.mp4, beside.mp4, scene.yaml, scene.xml, recording.rrd and result.json."""
        with progress.step("files"):
            _write(folder, self)
        write_result(folder, "edit", _record(self), self.seconds | progress.seconds)


def edit(found: str | Path, edits: Sequence[Edit] = (), progress: Progress | None = None) -> EditedClip:
    """Edit a clip.

    Args:
        found: A folder that `dynamics infer` wrote.
        edits: Changes of its scene (`pipeline.editing.edit_list`), in any order of time.
        progress: Told of each step; None: nothing is printed.

    Returns:
        The clip, taken apart and put together again with the edited motion.

    Raises:
        VideoError: The folder has no clip.
        SceneError: The scene cannot be read, or an edit does not fit it.
        SimulationError: The edited scene becomes unstable.
    """
    folder, progress = Path(found), progress or Progress()
    with progress.step("motion"):
        clip, scene = read_clip(folder / CLIP), load_scene(folder / SCENE_FILE)
        if scene.camera is None or not scene.objects:
            raise SceneError(f"{folder / SCENE_FILE}: a camera and at least one object are needed")
        ordered = in_order(edits, clip.schedule.seconds)
        filmed, trace = filmed_motion(scene, clip.times)
        motion = run_edits(scene, trace, ordered, clip.times)
    with progress.step("layers"):
        height, width = clip.masks.shape[1:]
        layers = take_apart(clip, filmed, view_of(scene, width, height))
    with progress.step("pictures"):
        rng = np.random.default_rng(SEED)
        pictures = compose(clip, layers, motion.motion, motion.origin, motion.first, rng, colours=motion.colour_of)
    return EditedClip(
        name=str(found),
        edits=tuple(ordered),
        clip=clip,
        original=scene,
        layers=layers,
        motion=motion,
        pictures=pictures,
        seconds=progress.seconds,
    )


def _write(folder: Path, run: EditedClip) -> None:
    """The files beside result.json."""
    made, times = run.pictures.frames, run.clip.times
    write_video(folder / "edited.mp4", made, times)
    write_video(folder / "beside.mp4", side_by_side(run.clip.frames, made, (ORIGINAL, EDITED)), times)
    (folder / SCENE_FILE).write_text(write_scene(run.motion.scene), encoding="utf-8")
    (folder / "scene.xml").write_text(scene_xml(run.motion.scene), encoding="utf-8")
    notes = "\n".join(["### What if", "", *(f"- {e}" for e in run.edits)])
    shown = Pictures(made, run.pictures.ids), Pictures(run.clip.frames, run.clip.masks)
    footage = Footage(
        name=f"{Path(run.name).resolve().name}, edited",
        notes=notes,
        motions=(),
        seen=shown[0],
        replayed=shown[1],
        times=times,
        titles=(EDITED, ORIGINAL),
    )
    save(footage, folder / "recording.rrd")


def _record(run: EditedClip) -> dict[str, Any]:
    """The entries of result.json."""
    measured = run.layers.registered.mean(0)
    return {
        "found": run.name,
        "edits": [e.record() for e in run.edits],
        "scene_at_s": round(run.motion.time, 4),
        "first_edited_frame": run.motion.first if run.edits else None,
        "pixels": _shares(("measured", "mirrored", "invented"), run.pictures.bodies),
        "background": _shares(("measured", "repaired", "invented"), run.pictures.background),
        "lights": [
            {"towards": [round(float(v), 4) for v in light[:3]], "shadow": round(float(dark), 4)}
            for light, dark in zip(run.layers.lights.light, run.layers.lights.darkness, strict=True)
        ],
        "registered": {o.name: round(float(share), 4) for o, share in zip(run.original.objects, measured, strict=True)},
        "noise": round(run.layers.plate.noise, 4),
        "shading": run.layers.lights.shading,
        "same_all_around": [
            o.name for o, same in zip(run.original.objects, run.layers.same_all_around, strict=True) if same
        ],
        "blur_px": run.layers.exposure.blur,
        "shutter": run.layers.exposure.shutter,
        "versions": {name: version(name) for name in ("dynamics-pipeline", "mujoco", "numpy")},
    }


def _shares(names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in zip(names, values, strict=True)}
