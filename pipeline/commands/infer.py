"""`dynamics infer`: from a video to a scene."""

from __future__ import annotations

import argparse
import importlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pipeline.commands.arguments import add_corrections, add_prompts, add_stretch, add_world, count, positive, share

SUMMARY = "find the scene that a clip shows: shapes, sizes, masses, frictions, motion, camera"
DESCRIPTION = """\
Find the scene that a clip shows.

The bodies that move are found (`dynamics masks` does only that) in the frames as they were filmed, each at its own time
(of 60 a second or more, every second, third ...), and optical flow is measured. The model is shown what its checkpoint
says that it was trained with (model_input.json; models/words: masks and flow of each body) and writes scenes, each is
simulated and compared with the clip, and --search refines the best ones. OUT then has

  overlay.png     the clip with the outlines of the replay over it, and both flows: look at this first
  masks.png       which bodies were found in the clip, written before anything is inferred from them
  replay.mp4      clip and replay beside each other
  scene.yaml      the scene, to edit and to run:  dynamics simulate OUT --set objects[0].mass=2
  scene.xml       the same as MJCF, for MuJoCo
  recording.rrd   for the rerun viewer:  rerun OUT/recording.rrd
  motion.png      place, speed and energy of each body against time, measured and of the replay
  tracks.parquet  the measured motion, for `dynamics discover`
  clip.npz        the frames and masks that were used, for `dynamics edit`
  result.json     what was assumed, what every step reached, and the time it took

The camera has to rest, and what moves should be rigid. Where masks.png is wrong, say what is a body: --point, --box,
--objects, --ignore. Slow motion: say with --fps at how many frames a second it
was shot; --start and --seconds count in that time.

examples:
  dynamics infer clip.mp4 -o out
  dynamics infer clip.mp4 -o out --start 2.5 --search 3000
  dynamics infer clip.mp4 -o out --point 120,80 --objects 1
  dynamics infer slow.mp4 -o out --fps 240 --masks found/masks.npz
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("clip", type=Path, metavar="CLIP", help="a video, or a folder with one and masks (masks.npz or masks/*.png)")
    add("-o", "--out", type=Path, required=True, metavar="OUT", help="folder for the results; it must not exist yet")
    add_stretch(parser)
    add("--fps", type=positive, metavar="F", help="frames a second at which it was shot, where the file's header lies")
    masks = (
        "instance masks: masks.npz of `dynamics masks`, or one for each frame of the recording, or of the clip at 30 "
    )
    masks += "FPS, as NPZ with `masks` or a folder of PNGs (default: the network in models/masks)"
    masks += "; sam2:PATH or edgetam:PATH: a published segmenter follows what it finds"
    add("--masks", metavar="PATH", help=masks)
    add_prompts(parser)
    add_corrections(parser)
    add_world(parser)
    add("--samples", type=count, default=8, metavar="K", help="answers sampled beside the greedy one (8)")
    add("--search", type=count, default=0, metavar="N", help="refine the best answers with N simulations (0: do not)")
    add("--incline", action="store_true", help="the ground may slope in the picture: the search may roll the camera")
    add("--model", default="models/words", metavar="NAME", help="a folder or hub name (models/words)")
    add("--raft", type=Path, default=Path("models/raft-small"), metavar="PATH", help="RAFT weights (models/raft-small)")
    add(
        "--flow",
        choices=("raft", "dis"),
        help="flow by RAFT, or by OpenCV's DIS (as in the model's training, else raft)",
    )
    add("--temperature", type=positive, default=1.0, help="of sampling words (1)")
    add("--top-p", type=share, default=0.9, help="of sampling words (0.9)")
    add(
        "--middle",
        type=share,
        default=0.4,
        help="share of what the model thinks of a number, about its median, from which samples are drawn (0.4)",
    )
    add("--seed", type=count, default=0, help="of sampling and search (0)")
    add("--force", action="store_true", help="replace OUT where `dynamics` wrote it and nothing else is in it")


def run(arguments: argparse.Namespace) -> None:
    from pipeline.api.result_folder import result_folder
    from pipeline.bodies.prompts import Prompts
    from pipeline.inference.asking import load_in_background
    from pipeline.inference.filmed_world import World
    from pipeline.inference.progress import Progress
    from pipeline.vision.recordings.clip_folder import video_of
    from pipeline.vision.recordings.corrections import Correction
    from pipeline.vision.recordings.video import check_file
    from pipeline.vision.rendering.render_backend import choose_backend

    a = arguments
    prompts = Prompts.of(a.point, a.box, a.ignore, a.objects)
    correction = Correction(a.distortion, a.steady)
    steps = 9 + bool(a.search)  # at most: a search that explains a clip leaves out the tracks
    with (
        result_folder(a.out, a.force) as folder,
        Progress(steps, shown=True) as progress,
        ThreadPoolExecutor(1, "prepare") as beside,
    ):
        check_file(video_of(a.clip))
        beside.submit(choose_backend, "auto")  # tries OpenGL in another process
        loading = load_in_background(a.model, "--model")  # imports torch while this thread imports the rest
        from pipeline.api.infer import infer
        from pipeline.api.mask_sheet import write_sheet
        from pipeline.bodies.user_clip import UserClip

        beside.submit(importlib.import_module, "pipeline.api.infer_files")  # while bodies are looked for

        def show(taken: UserClip) -> None:
            write_sheet(folder, str(a.clip), taken)
            progress.say("", f"masks.png shows them; while this command runs it is {folder / 'masks.png'}")

        found = infer(
            a.clip,
            start=a.start,
            seconds=a.seconds,
            fps=a.fps,
            masks=a.masks,
            prompts=prompts,
            correction=correction,
            model=loading,
            samples=a.samples,
            temperature=a.temperature,
            top_p=a.top_p,
            middle=a.middle,
            search=a.search,
            incline=a.incline,
            world=World.of(a.view, a.gravity, length=a.length, size=a.size, board=a.board, fixed=a.fixed),
            flow=a.flow,
            raft=a.raft,
            seed=a.seed,
            progress=progress,
            when_seen=show,
        )
        from pipeline.api.infer_files import method_table
        from pipeline.api.overlay import aligned
        from pipeline.search.certainty import weakly_identified

        for line in aligned(method_table(found.methods)):
            progress.say("", line)
        if found.scenes.certainties:
            weak = ", ".join(weakly_identified(found.scenes.certainties))
            progress.say("note", f"weakly determined by this clip: {weak or 'nothing'}")
        progress.say("scale", f"by {found.metric}" if found.metric != "none" else "not known: lengths are relative")
        if found.measured_gravity is not None:
            progress.say("gravity", f"{found.measured_gravity:.2f} m/s², from the motion at this scale")
        for line in found.joints:
            progress.say("joint", line)
        for line in found.doubts:
            progress.say("doubt", line)
        found.write(folder, progress)
    print(f"{'grade':<11}{found.grade.name}: {found.grade.reason}")
    print(f"{'written':<11}{a.out}: look at overlay.png first")
