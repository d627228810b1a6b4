"""`pipeline.discover`: which physics a scene lacks, from measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.api.discover_log import MODEL, LogDiscoveryResult, discover_log
from pipeline.api.discovery_folder import HELD_OUT, DiscoveryFolder, check_share, write_augmented
from pipeline.discovery.discover import discover as find_missing_physics
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.forces_file import forces_file
from pipeline.discovery.report.html_page import html_page
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.report.residual_table import residual_table
from pipeline.discovery.selection.testable import names_of
from pipeline.discovery.tables.said import Said
from pipeline.discovery.tracks.known_scene import KnownScene, load_known_scene
from pipeline.discovery.tracks.measured_file import MeasuredFile, read_measured
from pipeline.discovery.tracks.plausibility import check_plausible
from pipeline.discovery.tracks.track import Track
from pipeline.errors import ParamsError
from pipeline.inference.progress import Progress
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import save_scene
from pipeline.viewer.measured import save_measured


@dataclass(frozen=True)
class DiscoveryResult(DiscoveryFolder):
    """What `discover` found.

    Attributes:
        measured: Where the motion is from.
        known: Where the scene is from.
        clips: How many recordings there are.
        held_out: Share of them that was not fitted.
        effects: Which might be named.
        seed: That chose the clips held out.
        found: Everything that was computed.
        seconds: The time that each step took.
    """

    measured: str
    known: str
    clips: int
    held_out: float
    effects: str
    seed: int
    found: Discovery
    seconds: dict[str, float]

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json (docs/formats.md)."""
        return report_dict(self.found)

    @property
    def scene(self) -> Scene:
        """The scene with what it lacked."""
        return self.found.scene

    @cached_property
    def residuals(self) -> pa.Table:
        """Every sample, and what the models before and after make of it."""
        return residual_table(self.found)

    @property
    def asked(self) -> dict[str, Any]:
        """What was asked, for result.json."""
        return {
            "measured": self.measured,
            "scene": self.known,
            "held_out": self.held_out,
            "effects": self.effects,
            "seed": self.seed,
        }

    def write_pages(self, folder: Path) -> None:
        """Write report.html, the augmented scene and the recording."""
        facts = {
            "measured": self.measured,
            "scene": self.known,
            "clips": str(self.clips),
            "held out": ", ".join(self.report["clips"]["held_out"]) or "none",
            "noise": f"{1e3 * self.found.problem.sigma:.3g} mm",
            "seed": str(self.seed),
        }
        forecast = forecast_text(self.report)
        if forecast:
            facts["forecast of frames not fitted"] = forecast
        page = html_page(self.found, self.report, self.residuals, facts)
        (folder / "report.html").write_text(page, encoding="utf-8")
        save_scene(self.scene, folder / "augmented.yaml")
        launch = self.found.verdict.launch
        if launch is not None:
            save_scene(launch.scene, folder / "next.yaml")
        write_augmented(folder, scene_xml(self.scene), forces_file(self.scene))
        save_measured(self.residuals, Path(self.measured).stem, self.sentence, folder / "recording.rrd")


def forecast_text(report: Mapping[str, Any]) -> str:
    """How well frames of videos that were not fitted are forecast; empty where there are none."""
    gap = report["gap"]
    if gap.get("sequence_iou_before") is None:
        return ""
    return (
        f"sequence IoU {gap['sequence_iou_before']:.2f} without, {gap['sequence_iou_after']:.2f} with what was named; "
        f"end-point error {gap['epe_px_before']:.2f} and {gap['epe_px_after']:.2f} px"
    )


def discover(
    measured: str | Path | Sequence[Track],
    scene: str | Path | KnownScene,
    *,
    held_out: float = HELD_OUT,
    effects: str = "all",
    seed: int = 0,
    columns: str | None = None,
    unit: str | None = None,
    length: Sequence[float] | None = None,
    plane: str | None = None,
    fps: float | None = None,
    fit: Sequence[str] = (),
    progress: Progress | None = None,
) -> DiscoveryResult | LogDiscoveryResult:
    """Find out which physical effects a scene, or a user's own MuJoCo model, lacks.

    Args:
        measured: Measured motion, a file (docs/formats.md; or a table, a workbook or a project of Tracker as it is) or
            tracks that were read.
        scene: What is known of the scene, a file or a scene that was read; or a model, a file of MJCF (.xml). Measured
            motion is then the log of a mechanism, and the result that of `discover_log`.
        held_out: Share of the clips that is not fitted, for judging.
        effects: Which may be named: "all", or names with commas between.
        seed: Chooses the clips that are held out.
        columns: What the columns of a table are, "time=t,x=X1,y=-Y1"; None: what its header says.
        unit: Of the table's positions; None: what its header says, else m.
        length: A length in the table: (x0, y0, x1, y1, M), two points in its unit and their distance, m, or (N, M).
        plane: "upright" or "ground", in which a table's one or two coordinates lie; None: as bodies fall.
        fps: Frames per second, where a table counts frames.
        fit: Numbers of a model that are not known; a scene's file says its own.
        progress: Told of each step; None: nothing is printed.

    Returns:
        The verdict with its reasons, and the scene or the model with what it lacked.

    Raises:
        MeasurementError: For measurements that cannot be used, or do not fit the scene.
        SceneError: For a scene that cannot be read.
        ParamsError: For another argument that is not valid.
    """
    said = Said(columns, unit, length, fps, plane)
    if isinstance(scene, str | Path) and Path(scene).suffix == MODEL:
        if not isinstance(measured, str | Path):
            raise ParamsError(f"{scene}: a model needs the file of a log: Parquet, CSV or other text")
        if said != Said():
            raise ParamsError(
                f"{measured}: columns, unit, length, fps and plane are for a table of positions; the columns of a log "
                "are named as in the model, in SI units"
            )
        progress = progress or Progress()
        return discover_log(measured, scene, held_out=held_out, fit=fit, effects=effects, seed=seed, progress=progress)
    if fit:
        raise ParamsError("fit: it is for a model (.xml); the file of a scene lists its own under `fit:`")
    return discover_motion(measured, scene, held_out=held_out, effects=effects, seed=seed, said=said, progress=progress)


def discover_motion(
    measured: str | Path | Sequence[Track],
    scene: str | Path | KnownScene,
    *,
    held_out: float,
    effects: str,
    seed: int,
    said: Said,
    progress: Progress | None = None,
) -> DiscoveryResult:
    """`discover` for the scene of free bodies. said: what is known of a table that it does not say itself."""
    progress = progress or Progress()
    check_share(held_out)
    names = names_of(effects)
    known = load_known_scene(Path(scene)) if isinstance(scene, str | Path) else scene
    if isinstance(measured, str | Path):
        read = read_measured(Path(measured), known, said)
    else:
        read = MeasuredFile(list(measured), known)
    check_plausible(read.tracks, read.known)
    with progress.step("discover"):
        rng = np.random.default_rng(seed)
        found = find_missing_physics(read.tracks, read.known, held_out, names, rng, progress=progress.detail)
    found = replace(found, notes=(*read.notes, *found.notes))
    return DiscoveryResult(
        measured=str(measured) if isinstance(measured, str | Path) else "tracks",
        known=str(scene) if isinstance(scene, str | Path) else "scene",
        clips=len({t.clip for t in read.tracks}),
        held_out=held_out,
        effects=effects,
        seed=seed,
        found=found,
        seconds=progress.seconds,
    )
