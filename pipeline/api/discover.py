"""`pipeline.discover`: which physics a scene lacks, from measured motion."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.api.discover_log import MODEL, LogDiscoveryResult, discover_log
from pipeline.api.result_folder import FolderResult, write_result
from pipeline.discrepancy.discover import discover as find_missing_physics
from pipeline.discrepancy.report.discovery import Discovery
from pipeline.discrepancy.report.forces_file import forces_file
from pipeline.discrepancy.report.html_page import html_page, sentence
from pipeline.discrepancy.report.report_dict import report_dict
from pipeline.discrepancy.report.residual_table import residual_table
from pipeline.discrepancy.selection.testable import names_of
from pipeline.discrepancy.tracks.known_scene import KnownScene, load_known_scene
from pipeline.discrepancy.tracks.measured_file import MeasuredFile, read_measured
from pipeline.discrepancy.tracks.plausibility import check_plausible
from pipeline.discrepancy.tracks.track import Track
from pipeline.errors import ParamsError
from pipeline.inference.progress import Progress
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.scene.text import save_scene
from pipeline.tables.said import Said
from pipeline.viewer.measured import save_measured

REPORT = "report.json"
_VERSIONS = ("dynamics-pipeline", "mujoco", "numpy")


@dataclass(frozen=True)
class DiscoveryResult(FolderResult):
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
    def verdict(self) -> tuple[str, ...]:
        """The effects that the scene lacks: none, their names, or "unknown"."""
        return tuple(self.report["verdict"]["effects"])

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return sentence(self.report)

    @property
    def scene(self) -> Scene:
        """The scene with what it lacked."""
        return self.found.scene

    @cached_property
    def residuals(self) -> pa.Table:
        """Every sample, and what the models before and after make of it."""
        return residual_table(self.found)

    def write(self, folder: Path, progress: Progress) -> None:
        """Write report.html, report.json, augmented.yaml, augmented.xml, residuals.parquet, recording.rrd, times.json
        and result.json, and augmented_forces.py where augmented.xml cannot say an effect.
        """
        with progress.step("report"):
            self._write(folder)

    def _write(self, folder: Path) -> None:
        facts = {
            "measured": self.measured,
            "scene": self.known,
            "clips": str(self.clips),
            "held out": ", ".join(self.report["clips"]["held_out"]) or "none",
            "noise": f"{1e3 * self.found.problem.sigma:.3g} mm",
            "seed": str(self.seed),
        }
        residuals, said = self.residuals, self.sentence
        gap = self.report["gap"]
        if gap.get("sequence_iou_before") is not None:  # from videos
            facts["forecast of frames not fitted"] = (
                f"sequence IoU {gap['sequence_iou_before']:.2f} without, {gap['sequence_iou_after']:.2f} with what was "
                f"named; end-point error {gap['epe_px_before']:.2f} and {gap['epe_px_after']:.2f} px"
            )
        page = html_page(self.found, self.report, residuals, facts)
        pq.write_table(residuals, folder / "residuals.parquet", compression="zstd")
        (folder / "report.html").write_text(page, encoding="utf-8")
        save_scene(self.scene, folder / "augmented.yaml")
        (folder / "augmented.xml").write_text(scene_xml(self.scene), encoding="utf-8")
        forces = forces_file(self.scene)
        if forces is not None:
            (folder / "augmented_forces.py").write_text(forces, encoding="utf-8")
        save_measured(residuals, Path(self.measured).stem, said, folder / "recording.rrd")
        text = json.dumps(self.report, indent=1, ensure_ascii=False, allow_nan=False)
        (folder / REPORT).write_text(text + "\n", encoding="utf-8")
        write_result(
            folder,
            "discover",
            {
                "measured": self.measured,
                "scene": self.known,
                "held_out": self.held_out,
                "effects": self.effects,
                "seed": self.seed,
                "verdict": self.report["verdict"],
                "versions": {n: version(n) for n in _VERSIONS},
            },
            self.seconds,
        )


def discover(
    measured: str | Path | Sequence[Track],
    scene: str | Path | KnownScene,
    *,
    held_out: float = 0.3,
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
    if isinstance(scene, str | Path) and Path(scene).suffix == MODEL:
        if not isinstance(measured, str | Path):
            raise ParamsError(f"{scene}: a model needs the file of a log, a Parquet or CSV file")
        return discover_log(measured, scene, held_out=held_out, fit=fit, effects=effects, seed=seed, progress=progress)
    if fit:
        raise ParamsError("fit: it is for a model (.xml); the file of a scene lists its own under `fit:`")
    progress = progress or Progress()
    if not 0 <= held_out < 1:
        raise ParamsError(f"held_out is {held_out:g}; valid: a share of the clips, from 0 to less than 1")
    names = names_of(effects)
    known = load_known_scene(Path(scene)) if isinstance(scene, str | Path) else scene
    if isinstance(measured, str | Path):
        said = Said(columns, unit, length, fps, plane)
        found_file = read_measured(Path(measured), known, said)
    else:
        found_file = MeasuredFile(list(measured), known)
    tracks, known = found_file.tracks, found_file.known
    check_plausible(tracks, known)
    with progress.step("discover"):
        rng = np.random.default_rng(seed)
        found = find_missing_physics(tracks, known, held_out, names, rng, progress=progress.detail)
    found = replace(found, notes=(*found_file.notes, *found.notes))
    return DiscoveryResult(
        measured=str(measured) if isinstance(measured, str | Path) else "tracks",
        known=str(scene) if isinstance(scene, str | Path) else "scene",
        clips=len({t.clip for t in tracks}),
        held_out=held_out,
        effects=effects,
        seed=seed,
        found=found,
        seconds=progress.seconds,
    )
