"""`dynamics masks`: which bodies move in a video."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.commands.arguments import add_corrections, add_prompts, add_stretch, positive

SUMMARY = "find the bodies that move in a clip: their masks, to look at and for `dynamics infer --masks`"
DESCRIPTION = """\
Find the bodies that move in a clip.

A network looks at the frames in the video's own size, 30 a second. OUT then has

  masks.png       moments of the clip with outline, number and score of each body: look at this first
  overlay.mp4     the same in every frame
  masks.npz       `masks` (T, H, W), `ids`, `scores` and `times` (s): for  dynamics infer CLIP --masks OUT/masks.npz
  masks/          a PNG a frame; the palette index is the body's number
  result.json     the bodies, what was done because of prompts, and what may be wrong

The camera has to rest, and what moves should be rigid. Where masks.png is wrong, say what is a body: --point and --box
add one, --ignore drops one, --objects keeps the likeliest. At a --point or --box where the network finds nothing, a
region is grown by motion and colour and followed.

examples:
  dynamics masks clip.mp4 -o found
  dynamics masks clip.mp4 -o found --start 2.5 --point 120,80,2.6 --ignore 300,210
  dynamics masks slow.mp4 -o found --fps 240 --objects 2 --masks sam2:/models/sam2.1-hiera-tiny
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("clip", type=Path, metavar="CLIP", help="a video, or a folder with one")
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add_stretch(parser)
    add("--fps", type=positive, metavar="F", help="frames a second at which it was shot, where the file's header lies")
    add(
        "--masks", metavar="SEGMENTER", help="sam2:PATH or edgetam:PATH: follow what is found by it (our network alone)"
    )
    add_prompts(parser)
    add_corrections(parser)
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.masks import masks
    from pipeline.api.result_folder import result_folder
    from pipeline.bodies.prompts import Prompts
    from pipeline.inference.progress import Progress
    from pipeline.vision.recordings.corrections import Correction

    a = arguments
    prompts = Prompts.of(a.point, a.box, a.ignore, a.objects)
    with result_folder(a.out, a.force) as folder, Progress(2, shown=True) as progress:
        found = masks(
            a.clip,
            start=a.start,
            seconds=a.seconds,
            fps=a.fps,
            masks=a.masks,
            prompts=prompts,
            correction=Correction(a.distortion, a.steady),
            progress=progress,
        )
        found.write(folder, progress)
    print(f"{'written':<11}{a.out}: look at masks.png first")
