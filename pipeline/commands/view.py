"""`dynamics view`: a clip or a scene in the rerun viewer."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import count, positive

SUMMARY = "look at a clip of any shard, or at a scene, in 3D (rerun)"
DESCRIPTION = """\
Look at a clip of any shard, at a scene, or at what `dynamics infer` found, in the rerun viewer.

The 3D view has the bodies, the contacts as arrows of force, and the camera with its picture; beside it are masks,
optical flow and depth, below speeds, heights, events and the model's words. Two timelines: `sim_time` has every
simulation step, `frame` the frames of the video.

WHAT is a folder of shards (data/<stage>/<suite>; the other stages of the suite are shown along), one of its files, a
scene (YAML), or a folder that `dynamics infer` or `dynamics simulate` wrote. Without a display, --save writes a file
that `rerun FILE.rrd` opens elsewhere.

examples:
  dynamics view data/render/id --clip 3
  dynamics view out
  dynamics view scene.yaml --seconds 3 --save scene.rrd
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("what", type=Path, metavar="WHAT", help="shards, a file of them, a scene, or a folder of results")
    add("--clip", type=count, metavar="K", help="which clip of the shards (the first)")
    add("--seconds", type=positive, default=1.0, metavar="S", help="how long to run a scene, s (1)")
    add("--save", type=Path, metavar="FILE.rrd", help="write a recording instead of opening the viewer")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.commands.footage import show

    show(arguments.what, arguments.clip, arguments.seconds, arguments.save)
