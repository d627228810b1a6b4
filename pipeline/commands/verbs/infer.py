"""`dynamics infer`: from a video to a scene."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.words import count, existing_or_shipped, positive, share

SUMMARY = "find the scene that a clip shows: shapes, sizes, masses, frictions, motion, camera"
DESCRIPTION = """\
Find the scene that a clip shows.

The clip is brought to 30 FPS and 480x320, its optical flow is measured, the model reads the flow and writes
scenes, each is simulated and compared with the clip, and --search refines the best ones. OUT then has

  overlay.png     the clip with the outlines of the replay over it, and both flows: look at this first
  replay.mp4      clip and replay beside each other
  scene.yaml      the scene, to edit and to run:  dynamics simulate OUT --set objects[0].mass=2
  scene.xml       the same as MJCF, for MuJoCo
  recording.rrd   for the rerun viewer:  rerun OUT/recording.rrd
  result.json     what was assumed, what every step reached, and the time it took

The camera has to rest, and what moves should be rigid. Slow motion: say with --fps at how many frames a second it
was shot; --start and --seconds count in that time.

examples:
  dynamics infer clip.mp4 -o out
  dynamics infer clip.mp4 -o out --start 2.5 --search 3000
  dynamics infer slow.mp4 -o out --fps 240 --masks masks.npz
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("clip", type=Path, metavar="CLIP", help="a video, or a folder with one and masks (masks.npz or masks/*.png)")
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add("--start", type=float, default=0.0, metavar="S", help="where the clip begins in the video, s (0)")
    add("--seconds", type=positive, default=1.0, metavar="S", help="its length, s (1: what the models learned from)")
    add("--fps", type=positive, metavar="F", help="frames a second at which it was shot, where the file's header lies")
    masks = "instance masks, one for each frame of the recording, or of the clip at 30 FPS: NPZ with `masks`, or a "
    add("--masks", type=Path, metavar="PATH", help=masks + "folder of PNGs (default: from motion)")
    add("--samples", type=count, default=8, metavar="K", help="answers sampled beside the greedy one (8)")
    add("--search", type=count, default=0, metavar="N", help="refine the best answers with N simulations (0: do not)")
    add("--incline", action="store_true", help="the ground may slope in the picture: the search may roll the camera")
    add("--model", default="models/tiny", metavar="NAME", help="a folder or hub name (models/tiny)")
    add("--raft", type=Path, default=Path("models/raft-small"), metavar="PATH", help="RAFT weights (models/raft-small)")
    add("--flow", choices=("raft", "dis"), default="raft", help="flow by RAFT, or by OpenCV's DIS (raft)")
    add("--input", choices=("flow", "rgb"), default="flow", help="what the model was trained to look at (flow)")
    add("--no-reasoning", action="store_true", help="for a model that was trained to answer without <think>")
    add("--temperature", type=positive, default=1.0, help="of sampling words (1)")
    add("--top-p", type=share, default=0.9, help="of sampling words (0.9)")
    add("--middle", type=share, default=0.4, help="share of what the model thinks of a number, about its median, from "
        "which samples are drawn (0.4)")  # fmt: skip
    add("--seed", type=count, default=0, help="of sampling and search (0)")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.commands.infer_clip import Request, infer_clip
    from pipeline.model.generate import Sampling

    a = arguments
    sampling = Sampling(a.samples, a.temperature, a.top_p, not a.no_reasoning, a.seconds, middle=a.middle)
    infer_clip(Request(
        a.clip, a.out, a.start, a.seconds, a.fps, a.masks, a.search, a.incline, existing_or_shipped(a.model), a.flow,
        Path(existing_or_shipped(str(a.raft))), a.input, sampling, a.seed, a.force,
    ))  # fmt: skip
