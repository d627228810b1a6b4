"""`dynamics edit`: the clip itself, as it would have been filmed had its scene been another."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import add_edits, edits_of

SUMMARY = "change a number of a clip's scene and see the clip itself change"
DESCRIPTION = """\
Show a clip as it would have been filmed had its scene been another.

FOUND is a folder that `dynamics infer` wrote. The clip is taken apart: the background behind its bodies, their
shadows, and the surface of each body as far as it was seen. The edited scene is simulated, and the clip is put together
again with its own pixels. OUT then has

  edited.mp4     the edited clip
  beside.mp4     the original and the edited clip beside each other: look at this first
  scene.yaml     the edited scene, with its state at the last edit
  result.json    which share of the shown pixels was measured, mirrored by the shape's symmetry, or invented
  recording.rrd  for the rerun viewer

Edits hold from --at on (s of the clip; 0 by default); --edits FILE has a list of edits, each with its own time
(docs/editing.md). --set, --remove and --add may be given many times. Objects go by index or by name.

examples:
  dynamics edit out --set objects[0].mass=2 -o heavier
  dynamics edit out --remove box_1 --set gravity=1.62 --at 0.4 -o moon
  dynamics edit out --add ball.yaml -o one_more
  dynamics edit out --edits edits.yaml -o edited
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("found", type=Path, metavar="FOUND", help="a folder that `dynamics infer` wrote")
    add_edits(parser)
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.edit import edit
    from pipeline.api.result_folder import check_replaceable
    from pipeline.inference.progress import Progress

    a = arguments
    check_replaceable(a.out, a.force)
    edits = edits_of(a)
    with Progress(4, shown=True) as progress:
        made = edit(a.found, edits, progress)
        made.save(a.out, a.force, progress)
    if not edits:
        print("note       nothing was changed; give --set, as --set objects[0].mass=2")
    measured, mirrored, invented = (round(100 * share) for share in made.pictures.bodies)
    print(f"{'bodies':<11}{measured} % of their pixels measured, {mirrored} % mirrored, {invented} % invented")
    print(f"{'written':<11}{a.out}: beside.mp4 shows both")
