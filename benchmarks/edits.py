"""How well edited clips look: the round trip, in which every pixel is made anew though nothing was changed.

    python -m benchmarks.edits --drawn 12                     # fresh sampled clips, 480x320, with their true scenes
    python -m benchmarks.edits --suite id                     # the graph's clips with their true scenes
    python -m benchmarks.edits --suite real --scenes found    # with the scenes of the stage `fit`
    python -m benchmarks.edits --folders OUT...               # folders that `dynamics infer` wrote

Prints the PSNR (dB) of whole frames, inside of the bodies' masks and outside of them, the number of lights, and the
seconds of processor time. --pictures FOLDER keeps a picture of each clip: filmed, made anew, the plate and its kinds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from benchmarks.paired_clips import OBJECTS, SIZE, filmed
from pipeline.clips.schedule import Schedule
from pipeline.editing.compose import compose
from pipeline.editing.edited_motion import filmed_motion
from pipeline.editing.filmed_clip import CLIP, FilmedClip, read_clip
from pipeline.editing.layers import take_apart
from pipeline.editing.view import view_of
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene, read_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.dataset import open_shards
from pipeline.vision.rendering.appearance import sample_appearance, sample_sensor
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

SUITE = "edits"
STAGES = {"true": "sample", "found": "fit"}
KIND_COLOURS = np.array([(0, 0, 0), (255, 200, 0), (255, 0, 0)], np.uint8)  # of the plate: measured, repaired, invented


def suite_clips(data: Path, suite: str, scenes: str) -> Iterator[tuple[str, Scene, FilmedClip]]:
    """The clips of a suite of the graph, with true or found scenes."""
    pictures, texts = open_shards(data / "render" / suite), open_shards(data / STAGES[scenes] / suite)
    for clip in pictures:
        row, masks = texts[clip.index].row(), clip.array("mask")
        scene = read_scene(row["scene"])
        instances = row.get("instance", range(len(scene.objects)))
        table = np.full(256, 255, np.uint8)
        table[0] = 0
        for i, instance in enumerate(instances):
            if instance >= 0:
                table[instance + 1] = i + 1
        yield f"{suite}_{clip.index:03d}", scene, FilmedClip(clip.array("rgb"), table[masks], Schedule().times)


def drawn_clips(seed: int, clips: int) -> Iterator[tuple[str, Scene, FilmedClip]]:
    """Fresh clips of 1 to 3 objects with random looks, by MuJoCo's renderer, with their true scenes."""
    params, schedule = read_params_file(PARAMS_FILE, Params), Schedule()
    for index in range(clips):
        (scene,) = drawn_scenes(params, seed, SUITE, range(index, index + 1), OBJECTS)
        rng = clip_rng(seed, SUITE, index, "appearance")
        motion, _ = filmed_motion(scene, schedule.times)
        look, sensor = sample_appearance(rng, len(scene.objects)), sample_sensor(rng)
        shown = filmed(scene, motion, look, sensor, SIZE, rng)
        yield f"drawn_{index:03d}", scene, FilmedClip(shown.frames, shown.ids, schedule.times)


def found_clips(folders: list[Path]) -> Iterator[tuple[str, Scene, FilmedClip]]:
    """Clips with the scenes that were found in them."""
    for folder in folders:
        yield folder.name, load_scene(folder / "scene.yaml"), read_clip(folder / CLIP)


def psnr(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> float:
    """dB, over the pixels (T, H, W) of two clips (T, H, W, 3)."""
    squared = (one[where].astype(float) - other[where]) ** 2
    return float(10 * np.log10(255**2 / max(squared.mean(), 1e-9))) if squared.size else np.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data"), help="outputs of the graph (data)")
    parser.add_argument("--suite", help="whose clips")
    parser.add_argument("--drawn", type=int, metavar="N", help="so many fresh clips")
    parser.add_argument("--seed", type=int, default=84, help="of fresh clips (84)")
    parser.add_argument("--scenes", choices=tuple(STAGES), default="true")
    parser.add_argument("--clips", type=int, metavar="N", help="the first N of them")
    parser.add_argument("--folders", type=Path, nargs="*", default=[], metavar="OUT")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    a = parser.parse_args()
    print(f"{'clip':<14}{'frame':>8}{'bodies':>8}{'outside':>8}{'lights':>8}{'seconds':>9}  composition")
    rows = []
    if a.drawn is not None:
        clips = drawn_clips(a.seed, a.drawn)
    else:
        clips = found_clips(a.folders) if a.suite is None else suite_clips(a.data, a.suite, a.scenes)
    for name, scene, clip in islice(clips, a.clips):
        began = time.process_time()
        motion, _ = filmed_motion(scene, clip.times)
        height, width = clip.masks.shape[1:]
        layers = take_apart(clip, motion, view_of(scene, width, height))
        origin = tuple(range(len(scene.objects)))
        made = compose(clip, layers, motion, origin, 0, np.random.default_rng(0), redraw=True)
        seconds = time.process_time() - began
        inside = clip.masks > 0
        row = [psnr(made.frames, clip.frames, w) for w in (np.ones_like(inside), inside, ~inside)]
        rows.append(row)
        cells = "".join(f"{v:8.2f}" for v in row)
        print(f"{name:<14}{cells}{len(layers.lights.darkness):8d}{seconds:9.1f}  {scene.composition}", flush=True)
        if a.pictures is not None:
            a.pictures.mkdir(parents=True, exist_ok=True)
            chosen = [0, len(clip.frames) // 2, len(clip.frames) - 1]
            columns = [np.concatenate([clip.frames[t], made.frames[t]]) for t in chosen]
            plate = np.clip(layers.plate.colour, 0, 255).astype(np.uint8)
            columns.append(np.concatenate([plate, KIND_COLOURS[layers.plate.kind]]))
            picture = np.concatenate(columns, axis=1)
            cv2.imwrite(str(a.pictures / f"{name}.png"), picture[..., ::-1])
    if rows:
        for name, total in (("mean", np.nanmean), ("least", np.nanmin)):
            print(f"{name:<14}" + "".join(f"{v:8.2f}" for v in total(rows, axis=0)))


if __name__ == "__main__":
    main()
