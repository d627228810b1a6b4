"""`dynamics discover`: what physics does a simulation lack."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.commands.arguments import count, table_length
from pipeline.errors import ParamsError

if TYPE_CHECKING:
    from pipeline.api.discover_clips import ClipDiscoveryResult

TABLES = (".parquet", ".csv", ".tsv", ".txt", ".dat", ".xlsx", ".xls", ".ods", ".trk")
SUMMARY = "find where measured motion and a scene disagree, and name the physics that the scene lacks"
DESCRIPTION = """\
Find where measured motion and a scene disagree, and name the physics that the scene lacks.

The known scene is calibrated first (initial states, frictions, damping), so that a wrong number is not taken for a
missing law; then every effect is tried, alone and together, and judged on clips that were not fitted. OUT then has

  report.html        the verdict, its reasons and plots: look at this first
  report.json        the same for programs
  augmented.yaml     the scene with what was missing; augmented.xml: as MJCF, for plain MuJoCo, with augmented_forces.py
                     beside it where MJCF cannot say an effect
  next.yaml          the most informative next launch, where the verdict is uncertain and one helps (for simulate)
  residuals.parquet  every sample, and what both models make of it
  recording.rrd      measured, calibrated and augmented motion, for the rerun viewer

INPUT is measured motion and a scene, the log of a mechanism and your own MuJoCo model of it (.xml), or videos of one
resting camera (or folders that `dynamics infer` wrote).

Measured motion is Parquet or CSV with the columns clip, object, time, x, y, z (s, m, z up), optionally qw..qz,
wx..wz, sigma; or a table as it is: text of any separator, .xlsx, a project of Tracker (.trk). What was assumed of it is
said; --columns, --unit, --length, --plane and --fps say otherwise.
The scene file needs no more than each object's name, shape, sizes and mass. From videos OUT also has

  tracks.parquet     the measured motion
  replay.mp4         a clip with the outlines of both forecasts, by models that were fitted to the other clips

The log of an arm, a cart, a pendulum or a leg has the columns time and one for each measured joint, named as in the
model (rad, m); optionally clip, JOINT_velocity, sensors, SITE_x, _y, _z, sigma, and each actuator's control. What the
model says is known but for what --fit names. OUT then has augmented.xml, the model with what was missing, for plain
MuJoCo (and augmented_forces.py for friction that MJCF cannot say).

examples:
  dynamics discover tracks.csv scene.yaml -o found
  dynamics discover toss.txt ball.yaml -o found --columns time=t,x=X1,z=-Y1 --unit px --length 12,300,412,300=1.00
  dynamics discover log.csv robot.xml -o found --fit elbow.damping,forearm.mass
  dynamics discover tracks.parquet scene.yaml -o found --effects air_drag,linear_drag,wind
  dynamics discover roll_1.mp4 roll_2.mp4 roll_3.mp4 roll_4.mp4 --scene ball.yaml -o found
  dynamics simulate found/augmented.yaml --set 'effects=[]' -o without
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "inputs",
        type=Path,
        nargs="+",
        metavar="INPUT",
        help="MEASURED (a table) and SCENE (YAML) or MODEL (.xml), or videos",
    )
    add("--scene", type=Path, metavar="SCENE", help="what is known of the scene that videos show (YAML)")
    add("--columns", metavar="LIST", help="what the columns of a table are: time=t,x=X1,y=-Y1 (NAME:x=… of one body)")
    add("--unit", metavar="UNIT", help="of a table's positions: m, cm, mm, in, px, … (what its header says, else m)")
    add(
        "--length",
        type=table_length,
        metavar="X0,Y0,X1,Y1=M",
        help="two points of a table, in its unit, and their distance, m; or N=M",
    )
    add(
        "--plane",
        choices=("upright", "ground"),
        help="in which one or two coordinates of a table lie (upright where bodies fall)",
    )
    add("--view", choices=("table", "side"), help="how the camera of videos looks (bodies that fall tell)")
    add("--start", type=float, metavar="S", help="where each clip begins in its video (where bodies move freely)")
    add("--seconds", type=float, metavar="S", help="length of each clip (as long as they do)")
    add(
        "--fps",
        type=float,
        metavar="FPS",
        help="at which the videos were shot, where their headers are wrong, or "
        "frames per second of a table that counts frames",
    )
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add("--held-out", type=float, default=0.3, metavar="SHARE", help="share of clips kept for judging (0.3)")
    add("--fit", default="", metavar="NAMES", help="numbers of MODEL that are not known: NAME.damping, BODY.mass, ...")
    add("--effects", default="all", metavar="NAMES", help="which effects may be named, with commas between (all)")
    add("--seed", type=count, default=0, help="chooses the clips that are held out (0)")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.discover import DiscoveryResult, discover, forecast_text
    from pipeline.api.discover_log import LogDiscoveryResult
    from pipeline.api.result_folder import check_replaceable
    from pipeline.inference.progress import Progress

    a = arguments
    check_replaceable(a.out, a.force)
    table = any(place.suffix in TABLES for place in a.inputs)
    if table:
        _check_table(a)
    elif a.fit:
        raise ParamsError("--fit: it is for a log and a MODEL (.xml)")
    with Progress(2 if table else 4, shown=True) as progress:
        found: DiscoveryResult | LogDiscoveryResult | ClipDiscoveryResult
        if table:
            fit = [name.strip() for name in a.fit.split(",") if name.strip()]
            found = discover(
                *a.inputs,
                held_out=a.held_out,
                effects=a.effects,
                seed=a.seed,
                columns=a.columns,
                unit=a.unit,
                length=a.length,
                plane=a.plane,
                fps=a.fps,
                fit=fit,
                progress=progress,
            )
        else:
            from pipeline.api.discover_clips import discover_clips  # imports torch, which tables do not need

            found = discover_clips(
                a.inputs,
                a.scene,
                view=a.view,
                start=a.start,
                seconds=a.seconds,
                fps=a.fps,
                held_out=a.held_out,
                effects=a.effects,
                seed=a.seed,
                progress=progress,
            )
        found.save(a.out, a.force, progress)
    print(f"{'verdict':<11}{found.sentence}")
    for note in found.report["notes"]:
        print(f"{'note':<11}{note}")
    forecast = forecast_text(found.report)
    if forecast:
        print(f"{'forecast':<11}of frames not fitted: {forecast}")
    print(f"{'written':<11}{a.out}: look at report.html first")


def _check_table(a: argparse.Namespace) -> None:
    """Raise ParamsError unless one table and one scene were given, and nothing that is for videos."""
    if len(a.inputs) != 2 or a.inputs[0].suffix not in TABLES:
        given = " ".join(map(str, a.inputs))
        raise ParamsError(
            f"{given}: valid: one table of measured motion and one scene or model (MEASURED SCENE), or videos alone"
        )
    for name in ("scene", "view", "start", "seconds"):
        if getattr(a, name) is not None:
            raise ParamsError(
                f"--{name}: it is for videos; a table of measured motion has its scene as the second INPUT"
            )
