"""`pipeline.discover_clips`: which physics a scene lacks, from videos of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from scipy.ndimage import binary_erosion, generate_binary_structure

from pipeline.api.discover import DiscoveryResult, discover_motion
from pipeline.api.discovery_folder import HELD_OUT
from pipeline.api.overlay import side_by_side
from pipeline.api.result_folder import FolderResult
from pipeline.clips.replay import WIDTH
from pipeline.discovery.filmed.measured_motion import MeasuredMotion, measure_motion
from pipeline.discovery.filmed.reading import inferred_scene, is_inferred, read_recorded_clip
from pipeline.discovery.filmed.shown_effects import discover_shown
from pipeline.discovery.filmed.unfitted import ForecastClip, Unfitted
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.selection.testable import names_of
from pipeline.discovery.tables.said import Said
from pipeline.discovery.tracks.known_scene import KnownScene, known_scene, load_known_scene
from pipeline.discovery.tracks.track import tracks_table
from pipeline.errors import MeasurementError, SceneError
from pipeline.inference.progress import Progress
from pipeline.scene.scene import SIZE_KEYS, Scene
from pipeline.vision.recordings.video import write_video

VIEWS = {"table": "ground", "side": "upright"}
"""How a camera looks, as the user says it, and the plane in which bodies then move."""
OUTLINE = np.array([255, 60, 60], np.uint8)


@dataclass(frozen=True)
class ClipDiscoveryResult(FolderResult):
    """What `discover_clips` found.

    Attributes:
        result: The discovery from the measured motion.
        motion: What was measured.
        unfitted: Forecasts of the clips, by models that were fitted to the other clips.
    """

    result: DiscoveryResult
    motion: MeasuredMotion
    unfitted: Unfitted

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json (docs/formats.md)."""
        return self.result.report

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return self.result.sentence

    def write(self, folder: Path, progress: Progress) -> None:
        """Write the files of `DiscoveryResult`, tracks.parquet and, where a clip can be forecast, replay.mp4."""
        pq.write_table(tracks_table(self.motion.tracks), folder / "tracks.parquet", compression="zstd")
        if self.unfitted.before:
            pictures = _beside(self.unfitted.before[0], self.unfitted.after[0])
            times = self.unfitted.before[0].clip.times
            write_video(folder / "replay.mp4", pictures, (len(times) - 1) / float(times[-1] - times[0]))
        self.result.write(folder, progress)


def discover_clips(
    clips: Sequence[str | Path],
    scene: str | Path | KnownScene | None = None,
    *,
    view: str | None = None,
    start: float | None = None,
    seconds: float | None = None,
    fps: float | None = None,
    held_out: float = HELD_OUT,
    effects: str = "all",
    seed: int = 0,
    progress: Progress | None = None,
) -> ClipDiscoveryResult:
    """Find out which physical effects a scene lacks, from videos of one resting camera.

    Args:
        clips: Videos, or folders that `infer` wrote.
        scene: What is known of the scene, a file or a scene that was read; None: the objects that `infer` found in the
            first clip, which must be a folder of it.
        view: "table" (bodies on the ground) or "side" (bodies that move across the picture); None: their fall tells.
        start: s, where each clip begins in its video; None: where bodies move freely.
        seconds: Length of each clip; None: as long as they do.
        fps: Frames a second at which the videos were shot; None for what the files say.
        held_out: Share of the clips that is not fitted, for judging.
        effects: Which may be named: "all", or names with commas between.
        seed: Chooses the clips that are held out.
        progress: Told of each step; None: nothing is printed.

    Raises:
        VideoError: For a clip that cannot be used.
        MeasurementError: For bodies that cannot be matched or measured.
        SceneError: For a scene that cannot be read, or none.
        ParamsError: For another argument that is not valid.
    """
    progress = progress or Progress()
    places = [Path(c) for c in clips]
    known, source = _known(places, scene)
    names = _names(places)
    with progress.step("masks"):
        recorded = [
            read_recorded_clip(place, name, start=start, seconds=seconds, fps=fps)
            for place, name in zip(places, names, strict=True)
        ]
    with progress.step("tracks"):
        motion = measure_motion(recorded, known, None if view is None else VIEWS[view])

    def find(names: Sequence[str]) -> Discovery:
        listed = ",".join(names)
        own = discover_motion(
            motion.tracks, motion.known, held_out=held_out, effects=listed, seed=seed, said=Said(), progress=progress
        )
        return own.found

    shown = discover_shown(motion, names_of(effects), find)
    found = DiscoveryResult(
        measured=", ".join(map(str, places)),
        known=source,
        clips=len(motion.clips),
        held_out=held_out,
        effects=effects,
        seed=seed,
        found=shown.found,
        seconds=progress.seconds,
    )
    found.report["gap"].update(shown.unfitted.as_dict())
    found.report["notes"][:0] = [*motion.notes, *shown.notes]
    return ClipDiscoveryResult(found, motion, shown.unfitted)


def _names(places: Sequence[Path]) -> list[str]:
    """A name for each recording. Raises MeasurementError for a clip that is given twice."""
    names = [place.stem for place in places]
    if len(set(names)) < len(names):
        names = [f"{place.parent.name}/{place.stem}" for place in places]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise MeasurementError(f"clip {twice} is given twice; valid: each clip once")
    return names


def _known(places: Sequence[Path], scene: str | Path | KnownScene | None) -> tuple[KnownScene, str]:
    """The known scene, and where it is from."""
    if isinstance(scene, KnownScene):
        return scene, "scene"
    if scene is not None:
        return load_known_scene(Path(scene)), str(scene)
    if not is_inferred(places[0]):
        raise SceneError(
            f"{places[0]}: nothing is known of its bodies; valid: --scene with their names, shapes, sizes and masses, "
            f"or folders that `dynamics infer` wrote (`dynamics infer {places[0]} -o inferred`)"
        )
    return known_scene(_objects(inferred_scene(places[0]))), f"objects of {places[0]}"


def _objects(scene: Scene) -> dict[str, Any]:
    """The objects of a scene that was inferred, without its motion, camera and contacts."""
    entries = []
    for o in scene.objects:
        sizes = dict(zip(SIZE_KEYS[o.shape], map(float, o.size), strict=True))
        entries.append({"name": o.name, "shape": o.shape, **sizes, "mass": float(o.mass)})
    return {"objects": entries}


def _beside(before: ForecastClip, after: ForecastClip) -> np.ndarray:
    """The clip with the outlines of both forecasts, beside each other, (T, H, W, 3)."""
    left, right = before.clip.frames.copy(), after.clip.frames.copy()
    for frames, forecast in ((left, before), (right, after)):
        shown = forecast.shown > 0
        frames[shown & ~binary_erosion(shown, generate_binary_structure(2, 1)[None])] = OUTLINE
    both = side_by_side(left, right, ("without", "with what was named"))
    step = max(1, both.shape[2] // (4 * WIDTH))
    both = both[:, ::step, ::step]
    return both[:, : both.shape[1] // 2 * 2, : both.shape[2] // 2 * 2]
