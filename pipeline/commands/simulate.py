"""`dynamics simulate`: what if a number of the scene were another."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import add_edits, edits_of, positive

SUMMARY = "run a scene, change a number, see what would have happened"
DESCRIPTION = """\
Run a scene as it is and with changes, and compare.

A table says how far from its original end each object ends. With -o, OUT has the edited scene (scene.yaml, scene.xml),
replay.mp4 with the original and the edited motion beside each other, trajectory.csv with every state of both, and
recording.rrd for the rerun viewer.

SCENE is a scene file, a model's answer (text with <answer>), or a folder that `dynamics infer` wrote.
--set, --remove and --add may be given many times and hold from --at on; --edits FILE has a list of edits, each with its
own time: as `dynamics edit` takes them (docs/editing.md). Objects go by index or by name.

examples:
  dynamics simulate out --set objects[0].mass=2
  dynamics simulate scene.yaml --set gravity=1.62 --set 'objects[ball].velocity=[1, 0, 2]' --seconds 3 -o moon
  dynamics simulate scene.yaml --set objects[1].position[2]=0.5 --set camera.fov=60 -o higher
  dynamics simulate out --remove box_1 --add ball.yaml --at 0.4 -o other_bodies
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", type=Path, metavar="SCENE", help="a scene (YAML), an answer, or a folder with scene.yaml")
    add_edits(parser)
    add("-o", "--out", type=Path, metavar="OUT", help="folder for the results, that must not exist yet (none: a table)")
    add("--seconds", type=positive, default=1.0, metavar="S", help="how long to run, s (1)")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.overlay import aligned
    from pipeline.api.result_folder import check_replaceable
    from pipeline.api.simulate import simulate
    from pipeline.inference.progress import Progress

    a = arguments
    if a.out is not None:
        check_replaceable(a.out, a.force)
    edits = edits_of(a)
    found = simulate(a.scene, a.seconds, edits)
    for line in aligned(found.table()):
        print(line)
    if not edits:
        print("note: nothing was changed; give --set, as --set objects[0].mass=2")
    if a.out is not None:
        with Progress(1, shown=True) as progress:
            found.save(a.out, a.force, progress)
        print(f"written    {a.out}: replay.mp4 shows both")
