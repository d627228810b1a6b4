"""Shapes, overlap and flow of what the search finds on fresh sampled clips whose true masks are given.

    python -m benchmarks.shapes --seed N [--each 16] [--simulations 3200] [--workers 1] [--kept FOLDER] [--words WORDS]

The clips are drawn as those of the suite `id`: `each` of 1, 2 and 3 objects. The search gets the true masks at 480x320,
and rendered pictures with RAFT's flow of them, as in the graph, and nothing else. FOLDER keeps the measured clips and
the answers, so that a stopped run can be continued and two versions of the search see the same clips; `words` name the
version.
Prints composition, IoU and EPE with 95 % bootstrap intervals, and which true shape was found as which.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.kept_answers import answers_of, kept_answers, kept_folder
from pipeline.clips.intervals import bootstrap_mean
from pipeline.clips.overlap import assign, count, pair_iou
from pipeline.clips.replay import replay_poses
from pipeline.inference.scene_search import clip_evaluator
from pipeline.physics.simulate import simulate
from pipeline.report.markdown import markdown
from pipeline.report.scene_scores import score, true_reference
from pipeline.report.tables import cell
from pipeline.scene.scene import BASIC_SHAPES, Scene
from pipeline.scene.text import read_scene, write_scene
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.search.search_scene import search_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import load_raft
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from stages.render import Pictures
from training.drawn_scenes import drawn_scenes

COUNTS = (1, 2, 3)
METRICS = {
    "composition": "composition",
    "iou": "sequence IoU",
    "iou_initial": "IoU, first frame",
    "epe": "EPE on objects, px",
    "epe_frame": "EPE, whole frame, px",
    "seconds": "seconds",
}
RESAMPLES = 10_000
Job = tuple[Path, int, int, int, int, str]


def measured_clip(
    folder: Path, seed: int, objects: int, index: int, params: Params
) -> tuple[Scene, np.ndarray, np.ndarray]:
    """A fresh clip's scene, frames (F, H, W, 3), and RAFT's flow (P, H, W, 2) of them, kept in a file."""
    path = folder / f"seed-{seed}-objects-{objects}-clip-{index}.npz"
    if path.exists():
        with np.load(path) as kept:
            return read_scene(str(kept["scene"])), kept["frames"], kept["flow"]
    schedule, r = params.clip.schedule, params.render
    scene = drawn_scenes(params, seed, f"id {objects}", range(index, index + 1), {objects: 1.0})[0]
    how = r.model_dump(exclude={"width", "height"}) | {"backend": choose_backend(r.backend)[0]}
    rng = clip_rng(seed, f"id {objects}", index, "appearance")
    trace = simulate(scene, schedule.seconds)
    frames = Pictures(seed=seed, **how).render(scene, trace, schedule, (r.width, r.height), rng)
    flow = measured_flow(
        load_raft(Path(params.flow.raft)),
        frames,
        schedule.frame_steps / STEPS_PER_SECOND,
        schedule.pairs,
        1 / schedule.fps,
        params.flow.iterations,
        (params.flow.width, params.flow.height),
    ).astype(np.float32)
    with tempfile.NamedTemporaryFile(dir=folder, suffix=".npz", delete=False) as file:
        np.savez_compressed(file, scene=write_scene(scene), frames=frames, flow=flow)
    Path(file.name).rename(path)
    return scene, frames, flow


def answer(job: Job) -> dict[str, Any]:
    """The metrics of what the search finds in one clip."""
    folder, seed, objects, index, simulations, words = job
    warnings.simplefilter("ignore")
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    scene, frames, flow = measured_clip(folder, seed, objects, index, params)
    truth = true_reference(scene, schedule)
    evaluator = clip_evaluator(truth.masks, flow, schedule, params.search.size, 1, frames)
    found = search_scene(evaluator, [], simulations, clip_rng(seed, f"id {objects}", index, "search")).result
    masks = replay_poses(found.scene, schedule).masks
    pairs = assign(pair_iou(count(masks, truth.masks, len(found.scene.objects), len(scene.objects))))
    scores = score(found.scene, truth, schedule)
    return {
        "words": words,
        "seed": seed,
        "objects": objects,
        "clip": index,
        "budget": simulations,
        "simulations": found.simulations,
        "seconds": found.seconds,
        "true": [scene.shapes[j] for _, j in pairs],
        "found": [found.scene.shapes[i] for i, _ in pairs],
        "unseen": [i for i in range(len(scene.objects)) if not (truth.masks == i + 1).any()],
        "scene": write_scene(found.scene),
        **{m: scores[m] for m in METRICS if m in scores},
    }


def summary(answers: list[dict[str, Any]]) -> str:
    """Tables of the metrics and of the shapes found, a row for each version and budget."""
    out = []
    groups = sorted({(a["words"], a["seed"], a["budget"]) for a in answers})
    rows, confusion = [], []
    for group in groups:
        some = [a for a in answers if (a["words"], a["seed"], a["budget"]) == group]
        words, seed, budget = group
        cells = [cell(bootstrap_mean(np.array([float(a[m]) for a in some]), RESAMPLES)) for m in METRICS]
        rows.append([words, str(seed), str(budget), str(len(some)), *cells])
        pairs = Counter((t, f) for a in some for t, f in zip(a["true"], a["found"], strict=True))
        for true in BASIC_SHAPES:
            found = [str(pairs[true, f]) for f in BASIC_SHAPES]
            confusion.append([words, str(seed), str(budget), true, *found])
    out.append(markdown(["search", "seed", "budget", "clips", *METRICS.values()], rows))
    out.append(markdown(["search", "seed", "budget", "true shape", *(f"found {s}" for s in BASIC_SHAPES)], confusion))
    return "\n".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the clips")
    parser.add_argument("--each", type=int, default=16, help="clips of each number of objects")
    parser.add_argument("--simulations", type=int, default=3200)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--kept", type=Path, help="a folder for clips and answers; default: a temporary one")
    parser.add_argument("--words", default="this tree", help="name of this version of the search in the tables")
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to continue")
    asked = parser.parse_args()
    with kept_folder(asked.kept) as folder:
        path = folder / "answers.jsonl"
        answers = kept_answers(path)
        done = {(a["seed"], a["objects"], a["clip"], a["budget"], a["words"]) for a in answers}
        jobs = [
            (folder, asked.seed, objects, index, asked.simulations, asked.words)
            for index in range(asked.each)
            for objects in COUNTS
            if (asked.seed, objects, index, asked.simulations, asked.words) not in done
        ]
        found = answers_of(answer, jobs, path, asked.workers, asked.minutes)
        answers += tqdm(found, total=len(jobs), unit="clip", disable=None)
    print(summary(answers))


if __name__ == "__main__":
    main()
