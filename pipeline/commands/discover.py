"""`dynamics discover`: what physics does a simulation lack."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import count

SUMMARY = "find where measured motion and a scene disagree, and name the physics that the scene lacks"
DESCRIPTION = """\
Find where measured motion and a scene disagree, and name the physics that the scene lacks.

The known scene is calibrated first (initial states, frictions, damping), so that a wrong number is not taken for a
missing law; then every effect is tried, alone and together, and judged on clips that were not fitted. OUT then has

  report.html        the verdict, its reasons and plots: look at this first
  report.json        the same for programs
  augmented.yaml     the scene with what was missing; augmented.xml: as MJCF
  residuals.parquet  every sample, and what both models make of it
  recording.rrd      measured, calibrated and augmented motion, for the rerun viewer

MEASURED is Parquet or CSV with the columns clip, object, time, x, y, z (s, m, z up), optionally qw..qz, wx..wz, sigma.
SCENE is a scene file that needs no more than each object's name, shape, sizes and mass.

examples:
  dynamics discover tracks.csv scene.yaml -o found
  dynamics discover tracks.parquet scene.yaml -o found --effects air_drag,linear_drag,wind
  dynamics simulate found/augmented.yaml --set 'effects=[]' -o without
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("measured", type=Path, metavar="MEASURED", help="measured motion (.parquet or .csv)")
    add("scene", type=Path, metavar="SCENE", help="what is known of the scene (YAML)")
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add("--held-out", type=float, default=0.3, metavar="SHARE", help="share of clips kept for judging (0.3)")
    add("--effects", default="all", metavar="NAMES", help="which effects may be named, with commas between (all)")
    add("--seed", type=count, default=0, help="chooses the clips that are held out (0)")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.discover import discover
    from pipeline.api.result_folder import check_replaceable, result_folder
    from pipeline.inference.progress import Progress

    a = arguments
    check_replaceable(a.out, a.force)
    with Progress(2, shown=True) as progress:
        found = discover(a.measured, a.scene, held_out=a.held_out, effects=a.effects, seed=a.seed, progress=progress)
        with progress.step("report"), result_folder(a.out, a.force) as folder:
            found.write(folder)
    print(f"{'verdict':<11}{found.sentence}")
    for note in found.report["notes"]:
        print(f"{'note':<11}{note}")
    print(f"{'written':<11}{a.out}: look at report.html first")
