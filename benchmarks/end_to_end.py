"""From pixels alone to a scene: `infer` on another engine's clips, whose truth is used only for the scores.

    python -m benchmarks.end_to_end [--simulations 3200] [--minutes M] [--kept FOLDER] [--words WORDS] [CLIP ...]

Clips: `cross_engine` in DYNAMICS_DATA or ../shared/data; each is given as its video, without the masks beside it. Masks
are those that the network in models/masks finds, the model is the one that ships. Prints a row for each clip and the
means with 95 % bootstrap intervals: composition, sequence IoU of the scene's replay with the true masks, and video IoU
of the masks that were found. Composition and sequence IoU are also those of the bodies that move: one that rests for
the whole clip cannot be told from the background by its motion. A clip in which no scene is found scores 0. FOLDER
keeps the answers, so that a stopped run can be continued; `words` name the version.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kept_answers import answers_of, kept_answers, kept_folder
from benchmarks.mask_clips import moving_in
from pipeline.api.infer import infer
from pipeline.bodies.mask_source import MaskSource
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import read_frames, with_masks
from pipeline.clips.intervals import bootstrap_mean
from pipeline.clips.overlap import assign, count, pair_iou, sequence_iou
from pipeline.clips.replay import HEIGHT, WIDTH, replay_poses
from pipeline.errors import SimulationError, VideoError
from pipeline.report.markdown import markdown
from pipeline.report.tables import cell
from pipeline.scene.text import write_scene
from pipeline.search.target import resize_masks
from pipeline.vision.recordings.clip_folder import find_clips, masks_beside, video_of
from pipeline.vision.recordings.mask_file import only
from training.data_folder import needed

METRICS = {
    "composition": "composition",
    "iou": "sequence IoU",
    "moving_composition": "composition of what moves",
    "moving_iou": "sequence IoU of what moves",
    "masks": "masks' IoU",
    "seconds": "seconds",
}
RESAMPLES = 10_000
Job = tuple[Path, int, str]


def overlap_with(masks: np.ndarray, truth: np.ndarray) -> float:
    """Sequence IoU of ids (T, H, W) with true ones (T, H', W'), each found body assigned to a true one."""
    both = resize_masks(masks, WIDTH, HEIGHT), resize_masks(truth, WIDTH, HEIGHT)
    counts = count(*both, int(masks.max(initial=0)), int(truth.max(initial=0)))
    return float(sequence_iou(counts, assign(pair_iou(counts))))


def answer(job: Job) -> dict[str, Any]:
    """The scores of what `infer` finds in one clip."""
    place, simulations, words = job
    start = time.perf_counter()
    row: dict[str, Any] = {"clip": place.name, "budget": simulations, "words": words}
    told = json.loads((place / "truth.json").read_text())
    shapes = {o["id"]: o["type"] for o in told["objects"]}
    row["true"] = "+".join(sorted(shapes.values()))
    try:
        found = infer(video_of(place), start=0.0, search=simulations)  # also where no body is seen at first
    except (VideoError, SimulationError) as error:
        seconds = time.perf_counter() - start
        return row | dict.fromkeys(METRICS, 0.0) | {"found": str(error), "seconds": seconds}
    schedule, taken = found.clip.schedule, found.clip.taken
    read = read_frames(place, seconds=schedule.seconds, source=MaskSource(masks_beside(place)))
    truth = with_masks(read, Prompts()).masks
    moving = moving_in(told, np.load(masks_beside(place))["masks"])
    scene = found.best.scene
    shown = replay_poses(scene, schedule, *taken.clip.letterbox.size).masks
    return row | {
        "found": scene.composition,
        "by": found.best.name,
        "composition": float(scene.composition == row["true"]),
        "iou": overlap_with(shown, truth),
        "moving_composition": float(scene.composition == "+".join(sorted(shapes[i] for i in moving))),
        "moving_iou": overlap_with(shown, only(truth, moving)),
        "masks": overlap_with(taken.masks, truth),
        "seconds": time.perf_counter() - start,
        "scene": write_scene(scene),
    }


def summary(answers: list[dict[str, Any]]) -> str:
    """A table of the clips and one of the means, of answers of one or more versions and budgets."""
    rows, means = [], []
    for group in sorted({(a["words"], a["budget"]) for a in answers}):
        some = sorted((a for a in answers if (a["words"], a["budget"]) == group), key=lambda a: a["clip"])
        rows += [
            [group[0], a["clip"], a["true"], a["found"], a.get("by", ""), f"{a['iou']:.3f}", f"{a['masks']:.3f}"]
            for a in some
        ]
        cells = [cell(bootstrap_mean(np.array([float(a[m]) for a in some]), RESAMPLES)) for m in METRICS]
        means.append([group[0], str(group[1]), str(len(some)), *cells])
    clips = markdown(["version", "clip", "true", "found", "by", "sequence IoU", "masks' IoU"], rows)
    return clips + "\n" + markdown(["version", "budget", "clips", *METRICS.values()], means)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="*", help="names of clips; all by default")
    parser.add_argument("--simulations", type=int, default=3200)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to continue")
    parser.add_argument("--kept", type=Path, help="a folder for the answers; default: a temporary one")
    parser.add_argument("--words", default="this tree", help="name of this version in the tables")
    asked = parser.parse_args()
    folder = needed("cross_engine")
    places = [p for p in find_clips(folder) if p.is_dir() and (not asked.clips or p.name in asked.clips)]
    with kept_folder(asked.kept) as kept:
        path = kept / "answers.jsonl"
        answers = kept_answers(path)
        done = {(a["clip"], a["budget"], a["words"]) for a in answers}
        jobs = [(p, asked.simulations, asked.words) for p in places]
        jobs = [j for j in jobs if (j[0].name, j[1], j[2]) not in done]
        for row in answers_of(answer, jobs, path, asked.workers, asked.minutes):
            print(f"{row['clip']}  {row['true']} -> {row['found']}  IoU {row['iou']:.3f}", flush=True)
            answers.append(row)
    print(summary(answers))


if __name__ == "__main__":
    main()
