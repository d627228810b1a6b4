"""Edited clips against the clip that MuJoCo renders of the edited scene, given the true scene or the one `infer` finds.

    python -m benchmarks.paired_edits [--pairs 63] [--size 240 160] [--minutes M] [--kept FOLDER]
    python -m benchmarks.paired_edits --pairs 21 --scenes found|masks [--simulations 2000] --kept FOLDER

Each pair is a drawn clip with random looks and the same clip after an edit: of mass, friction, velocity, gravity, a
removed body, an added one, a velocity at mid-clip. With `found`, `infer` sees only the video, with `masks` also the
true masks; the edit is carried over to its scene (`benchmarks/transferred_edit.py`). Compared with the true edited clip
are the edited clip, the clip as it was (no edit), and primitives in plain colours as `dynamics simulate` draws them. Of
the bodies that the edit adds, removes or moves elsewhere, from the edit on: IoU of their masks; PSNR inside of their
masks in either clip, dB; of those that it moves, the distance of the masks' centroids from the true ones, px of
480x320. Where `infer` fails, or does not find the body that is edited, the edited clip and the primitives count as no
edit.

FOLDER keeps the answers, the scenes that were found and their clips, so that a stopped run can be continued. --again
makes the edited clips anew from the scenes that it has. --pictures FOLDER keeps a picture of each pair: the clip, the
edited clip, the true one, primitives.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.edits import psnr
from benchmarks.kept_answers import answers_of, kept_answers, kept_folder
from benchmarks.paired_clips import ADDED, KINDS, SIZE, Pair, Shown, draw_pair, drawn_plain, shown_bodies
from benchmarks.transferred_edit import Counterpart, transferred
from pipeline.api.infer import infer
from pipeline.api.infer_files import relabelled
from pipeline.clips.overlap import assign, count, pair_iou
from pipeline.clips.schedule import Schedule
from pipeline.editing.compose import compose, follow
from pipeline.editing.edited_motion import EditedMotion, filmed_motion, run_edits
from pipeline.editing.filmed_clip import CLIP, FilmedClip, read_clip, write_clip
from pipeline.editing.layers import take_apart
from pipeline.editing.view import BodyMotion, view_of
from pipeline.errors import SceneError, SimulationError, VideoError
from pipeline.report.markdown import markdown
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene, write_scene
from pipeline.vision.recordings.video import write_video
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file

METHODS = {"edited": "edited", "none": "no edit", "plain": "primitives"}
METRICS = {"iou": "IoU", "psnr": "PSNR, dB", "error": "error, px"}
LEAST_IOU = 0.1  # mean over the clip, from which on a found object is a true one
SCENE = "scene.yaml"
SCENES = {
    "true": "the true scenes",
    "found": "the scenes that `infer` finds with {} simulations",
    "masks": "the scenes that `infer` finds with the true masks and {} simulations",
}
Job = tuple[Path, int, int, str, int, tuple[int, int], Path | None]


def scores(shown: Shown, pair: Pair) -> dict[str, float]:
    """The metrics of a clip against the true edited one."""
    true, first = pair.after, pair.made.first
    shared = either = 0
    where = np.zeros(true.ids.shape, bool)
    for name in pair.concerned:
        one, other = shown.mask(name)[first:], true.mask(name)[first:]
        shared, either = shared + int((one & other).sum()), either + int((one | other).sum())
        where |= pair.before.mask(name) | true.mask(name)
    where[:first] = False
    apart = []
    for name in pair.moved:
        if name in shown.names:
            seen = true.mask(name).any((1, 2))
            seen[:first] = False
            apart.append(np.linalg.norm(shown.places(name) - true.places(name), axis=-1)[seen])
    distances = np.concatenate(apart) if apart else np.zeros(0)
    return {
        "iou": shared / either if either else 1.0,
        "psnr": psnr(shown.frames, true.frames, where),
        "error": float(distances.mean()) * SIZE[0] / true.size[0] if len(distances) else np.nan,
    }


def edited_clip(scene: Scene, clip: FilmedClip, motion: BodyMotion, made: EditedMotion, names: Sequence[str]) -> Shown:
    """The edited clip, and where it shows its bodies.

    Args:
        scene: Of the clip.
        clip: T frames.
        motion: Of the scene.
        made: The edited motion, M bodies.
        names: (M,), by which they are called.
    """
    height, width = clip.masks.shape[1:]
    layers = take_apart(clip, motion, view_of(scene, width, height))
    noise = np.random.default_rng(0)
    pictures = compose(clip, layers, made.motion, made.origin, made.first, noise, colours=made.colour_of)
    _, corrections = follow(layers, made.motion, made.origin, made.first, False)
    return Shown(tuple(names), pictures.frames, pictures.ids, corrections[..., :2] + corrections[..., 2:4])


def found_scene(folder: Path, pair: Pair, simulations: int, with_masks: bool) -> tuple[Scene, FilmedClip]:
    """What `infer` finds in the video of a pair's first clip, kept in a folder.

    Args:
        folder: Where it is kept.
        pair: The pair.
        simulations: Of the search.
        with_masks: Whether it is given the true masks.

    Raises:
        VideoError: The clip cannot be used.
        SimulationError: No answer can be simulated.
    """
    if not (folder / SCENE).exists():
        folder.mkdir(parents=True, exist_ok=True)
        schedule, masks = Schedule(), folder / "masks.npz"
        write_video(folder / "clip.mp4", pair.before.frames, schedule.fps)
        if with_masks:
            ids, times = np.arange(1, len(pair.before.names) + 1), np.arange(schedule.frames) / schedule.fps
            np.savez_compressed(masks, masks=pair.before.ids, ids=ids, times=times)
        found = infer(
            folder / "clip.mp4",
            start=0.0,
            seconds=schedule.seconds,
            masks=masks if with_masks else None,
            search=simulations,
        )
        masks = relabelled(found.clip.taken.masks, found.best.overlap.pairs, len(found.scene.objects))
        write_clip(folder / CLIP, FilmedClip(found.clip.taken.clip.frames, masks, found.clip.schedule.times))
        (folder / SCENE).write_text(write_scene(found.scene), encoding="utf-8")
    return load_scene(folder / SCENE), read_clip(folder / CLIP)


def _with_found_scene(folder: Path, pair: Pair, simulations: int, with_masks: bool) -> tuple[str, Shown, Shown]:
    """What was found, the edited clip and the primitives; raises VideoError, SimulationError or SceneError."""
    scene, clip = found_scene(folder, pair, simulations, with_masks)
    motion, trace = filmed_motion(scene, clip.times)
    iou = pair_iou(
        count(clip.masks, pair.before.ids, max(len(scene.objects), int(clip.masks.max())), len(pair.before.names))
    )[:, : len(scene.objects)]
    pairs = np.array([(i, j) for i, j in assign(iou) if np.nan_to_num(iou[:, i, j]).mean() >= LEAST_IOU])
    edit = transferred(pair.edit, Counterpart(pair.scene, scene, pairs.reshape(-1, 2)))
    if edit is None:
        raise SceneError("the edited body was not found")
    made = run_edits(scene, trace, [edit], clip.times)
    called = {scene.objects[i].name: pair.scene.objects[j].name for i, j in pairs} | {ADDED: ADDED}
    names = [called.get(o.name, f"unknown {o.name}") for o in made.motion.objects]
    left = shown_bodies(made.motion)
    changed = replace(scene, gravity=made.scene.gravity)
    size = clip.masks.shape[2], clip.masks.shape[1]
    plain = replace(
        drawn_plain(changed, left, size), names=tuple(called.get(o.name, f"unknown {o.name}") for o in left.objects)
    )
    return scene.composition, edited_clip(scene, clip, motion, made, names), plain


def _with_true_scene(pair: Pair) -> tuple[str, Shown, Shown]:
    schedule = Schedule()
    motion, _ = filmed_motion(pair.scene, schedule.times)
    clip = FilmedClip(pair.before.frames, pair.before.ids, schedule.times)
    names = [o.name for o in pair.made.motion.objects]
    changed, left = replace(pair.scene, gravity=pair.made.scene.gravity), shown_bodies(pair.made.motion)
    plain = drawn_plain(changed, left, pair.before.size)
    return pair.scene.composition, edited_clip(pair.scene, clip, motion, pair.made, names), plain


def answer(job: Job) -> dict[str, Any]:
    """The scores of one pair."""
    kept, seed, number, scenes, simulations, size, pictures = job
    warnings.simplefilter("ignore")
    pair = draw_pair(read_params_file(PARAMS_FILE, Params), seed, number, size)
    row: dict[str, Any] = {"seed": seed, "pair": number, "scenes": scenes, "kind": pair.kind, "edit": str(pair.edit)}
    row |= {
        "budget": 0 if scenes == "true" else simulations,
        "true": pair.scene.composition,
        "size": list(size),
        "refused": pair.refused,
        "failed": None,
    }
    edited = plain = pair.before
    try:
        if scenes == "true":
            row["composition"], edited, plain = _with_true_scene(pair)
        else:
            given = scenes == "masks"
            folder = kept / f"seed-{seed}-pair-{number}-{simulations}{'-masks' if given else ''}"
            row["composition"], edited, plain = _with_found_scene(folder, pair, simulations, given)
    except (VideoError, SimulationError, SceneError) as error:
        row["failed"] = str(error)
    for method, shown in {"edited": edited, "none": pair.before, "plain": plain}.items():
        for metric, value in scores(shown, pair).items():
            row[f"{method}.{metric}"] = None if np.isnan(value) else value
    if pictures is not None:
        _write_picture(pictures / f"{scenes}_{number:02d}_{pair.kind}.jpg", [pair.before, edited, pair.after, plain])
    return row


def _write_picture(path: Path, rows: Sequence[Shown]) -> None:
    """A row of four frames for each clip."""
    path.parent.mkdir(parents=True, exist_ok=True)
    chosen = np.linspace(0, len(rows[0].frames) - 1, 4).astype(int)
    columns = [np.concatenate([shown.frames[t] for shown in rows]) for t in chosen]
    cv2.imwrite(str(path), np.concatenate(columns, axis=1)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


def summary(answers: Sequence[dict[str, Any]]) -> str:
    """A table for each kind of scenes: a row for each kind of edit, and one for all."""
    out = []
    settings = sorted({(a["scenes"], a["budget"]) for a in answers}, key=lambda g: (list(SCENES).index(g[0]), g[1]))
    for scenes, budget in settings:
        some = [a for a in answers if (a["scenes"], a["budget"]) == (scenes, budget)]
        heading = [f"{METHODS[m]} {METRICS[k]}" for k in METRICS for m in METHODS]
        rows = []
        right = [a for a in some if a.get("composition") == a["true"]]
        groups = {kind: [a for a in some if a["kind"] == kind] for kind in KINDS} | {"all": some}
        if scenes != "true":
            groups |= {"shapes right": right, "shapes wrong": [a for a in some if a not in right]}
        for kind, group in groups.items():
            if group:
                means = [_mean(group, f"{m}.{k}") for k in METRICS for m in METHODS]
                ratio = means[-2] / max(means[-3], 1e-9)
                failed = sum(a["failed"] is not None for a in group)
                cells = [f"{v:.2f}" if np.isfinite(v) else "" for v in means]
                gain = f"{ratio:.1f}" if np.isfinite(ratio) else ""
                rows.append([kind, str(len(group)), str(failed), *cells, gain])
        ratios = [a["none.error"] / max(a["edited.error"], 1e-9) for a in some if a["none.error"] is not None]
        table = markdown(["edit", "pairs", "failed", *heading, "times nearer"], rows)
        median = f"Median over pairs of how many times nearer: {np.median(ratios):.1f}.\n" if ratios else ""
        refused = sum(a.get("refused", 0) for a in some)
        drawn = f"Drawn edits that did not fit their scene, and were drawn again: {refused}.\n"
        out.append(f"With {SCENES[scenes].format(budget)}:\n\n{table}\n{median}{drawn}")
    return "\n".join(out)


def _mean(answers: Sequence[dict[str, Any]], key: str) -> float:
    values = [a[key] for a in answers if a[key] is not None]
    return float(np.mean(values)) if values else np.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=63)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--scenes", choices=tuple(SCENES), default="true")
    parser.add_argument("--simulations", type=int, default=2000, help="of the search, without the true scenes")
    parser.add_argument(
        "--size",
        type=int,
        nargs=2,
        default=SIZE,
        metavar=("W", "H"),
        help="of the clips, px (480 320); another with true scenes only",
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to continue")
    parser.add_argument("--kept", type=Path, help="a folder for the answers and scenes; default: a temporary one")
    parser.add_argument("--again", action="store_true", help="forget the answers that it has, not the scenes")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    a = parser.parse_args()
    if a.scenes != "true" and tuple(a.size) != SIZE:
        parser.error(f"--size: `infer` answers at {SIZE[0]} {SIZE[1]}; another size needs --scenes true")
    with kept_folder(a.kept) as kept:
        path, budget = kept / f"{a.scenes}.jsonl", 0 if a.scenes == "true" else a.simulations
        if a.again:
            path.unlink(missing_ok=True)
        answers = kept_answers(path)
        done = {(x["seed"], x["pair"], x["budget"]) for x in answers}
        jobs: list[Job] = [
            (kept, a.seed, number, a.scenes, a.simulations, tuple(a.size), a.pictures)
            for number in range(a.pairs)
            if (a.seed, number, budget) not in done
        ]
        for row in answers_of(answer, jobs, path, a.workers, a.minutes):
            failed = f"  failed: {row['failed']}" if row["failed"] else ""
            cells = "".join(f"{_text(row[f'{m}.{k}'])}" for k in METRICS for m in METHODS)
            print(f"{row['pair']:<4}{row['kind']:<10}{cells}{failed}", flush=True)
            answers.append(row)
        print(summary(answers))


def _text(value: float | None) -> str:
    return f"{value:8.2f}" if value is not None else f"{'':8}"


if __name__ == "__main__":
    main()
