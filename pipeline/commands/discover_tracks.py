"""`dynamics discover`: from files to a folder with the verdict, its reasons, and the scene with what was missing."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from pipeline.commands.progress import Progress
from pipeline.commands.result_folder import check_replaceable, result_folder, write_result
from pipeline.discrepancy.discover import discover
from pipeline.discrepancy.report.discovery import Discovery
from pipeline.discrepancy.report.html_page import html_page, sentence
from pipeline.discrepancy.report.report_dict import report_dict
from pipeline.discrepancy.report.residual_table import residual_table
from pipeline.discrepancy.selection.testable import names_of
from pipeline.discrepancy.tracks.known_scene import load_known_scene
from pipeline.discrepancy.tracks.track import read_tracks
from pipeline.errors import ParamsError
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.text import write_scene
from pipeline.viewer.measured import save_measured

REPORT = "report.json"
_VERSIONS = ("dynamics-pipeline", "mujoco", "numpy")


def discover_tracks(
    measured: Path, scene: Path, out: Path, held_out: float, effects: str, seed: int, force: bool
) -> None:
    """Read, discover, write `out`. Raises DynamicsError; nothing is written then."""
    if not 0 <= held_out < 1:
        raise ParamsError(f"--held-out {held_out:g}: valid: a share of the clips, from 0 to less than 1")
    try:
        names = names_of(effects)
    except ValueError as error:
        raise ParamsError(f"--effects: {error}") from None
    check_replaceable(out, force)
    known, tracks = load_known_scene(scene), read_tracks(measured)
    with Progress(2) as progress:
        with progress.step("discover"):
            found = discover(tracks, known, held_out, names, np.random.default_rng(seed), progress=progress.detail)
        content = report_dict(found)
        with progress.step("report"), result_folder(out, force) as folder:
            facts = {
                "measured": str(measured), "scene": str(scene), "clips": str(len({t.clip for t in tracks})),
                "held out": ", ".join(content["clips"]["held_out"]) or "none",
                "noise": f"{1e3 * found.problem.sigma:.3g} mm", "seed": str(seed),
            }  # fmt: skip
            _write(folder, found, content, facts, measured.stem)
            write_result(folder, "discover", {
                "measured": str(measured), "scene": str(scene), "held_out": held_out, "effects": effects, "seed": seed,
                "verdict": content["verdict"], "seconds": progress.seconds,
                "versions": {n: version(n) for n in _VERSIONS},
            })  # fmt: skip
    print(f"{'verdict':<11}{sentence(content)}")
    for note in content["notes"]:
        print(f"{'note':<11}{note}")
    print(f"{'written':<11}{out}: look at report.html first")


def _write(folder: Path, found: Discovery, content: dict[str, object], facts: dict[str, str], name: str) -> None:
    """All files; report.json last."""
    table = residual_table(found)
    pq.write_table(table, folder / "residuals.parquet", compression="zstd")
    (folder / "augmented.yaml").write_text(write_scene(found.scene), encoding="utf-8")
    (folder / "augmented.xml").write_text(scene_xml(found.scene), encoding="utf-8")
    save_measured(table, name, sentence(content), folder / "recording.rrd")
    (folder / "report.html").write_text(html_page(found, content, table, facts), encoding="utf-8")
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / REPORT).write_text(text + "\n", encoding="utf-8")
