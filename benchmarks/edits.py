"""How well edited clips look: the round trip, in which every pixel is made anew though nothing was changed.

    python -m benchmarks.edits --sampled 4                    # sampled clips with their true scenes
    python -m benchmarks.edits --found OUT...                 # folders that `dynamics infer` wrote

Prints the PSNR (dB) of whole frames, inside of the bodies' masks and outside of them; --pictures FOLDER keeps a picture
of each clip: as filmed, made anew, and the plate.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.editing.compose import compose
from pipeline.editing.edited_motion import filmed_motion
from pipeline.editing.filmed_clip import CLIP, FilmedClip, read_clip
from pipeline.editing.layers import take_apart
from pipeline.editing.view import view_of
from pipeline.scene.scene import Scene
from pipeline.scene.text import load_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

SIZE = (480, 320)
OBJECTS = {1: 1.0, 2: 1.0, 3: 1.0}
SUITE = "edits"


def sampled_clips(seed: int, count: int, backend: str) -> Iterator[tuple[str, Scene, FilmedClip]]:
    """Clips as the suites draw them, with their true scenes and masks."""
    params = read_params_file(PARAMS_FILE, Params)
    schedule = Schedule(**params.clip.model_dump())
    for index in range(count):
        (scene,) = drawn_scenes(params, seed, SUITE, range(index, index + 1), OBJECTS)
        motion, _ = filmed_motion(scene, schedule.frames, schedule.fps)
        rng = clip_rng(seed, SUITE, index, "appearance")
        look, sensor = sample_appearance(rng, len(scene.objects)), sample_sensor(rng)
        frames = render_rgb(scene, motion.position, motion.quaternion, look, *SIZE, backend)
        assert scene.camera is not None
        camera = pinhole(scene.camera)
        masks = rasterise(scene.objects, motion.position, motion.quaternion, camera, *SIZE, scene.ground).mask
        yield f"sampled_{index:02d}", scene, FilmedClip(apply_sensor(frames, sensor, rng), masks, schedule.fps)


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
    parser.add_argument("--sampled", type=int, default=0, metavar="N", help="how many sampled clips")
    parser.add_argument("--found", type=Path, nargs="*", default=[], metavar="OUT", help="folders of `dynamics infer`")
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--backend", default="mujoco", choices=("mujoco", "raycast"))
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    a = parser.parse_args()
    print(f"{'clip':<14}{'frame':>8}{'bodies':>8}{'outside':>8}{'lights':>8}{'seconds':>9}  composition")
    rows = []
    for name, scene, clip in [*sampled_clips(a.seed, a.sampled, a.backend), *found_clips(a.found)]:
        began = time.perf_counter()
        motion, _ = filmed_motion(scene, len(clip.frames), clip.fps)
        height, width = clip.masks.shape[1:]
        layers = take_apart(clip, motion, view_of(scene, width, height))
        origin = tuple(range(len(scene.objects)))
        made = compose(clip, layers, motion, origin, 0, np.random.default_rng(0), redraw=True)
        seconds = time.perf_counter() - began
        inside = clip.masks > 0
        row = [psnr(made.frames, clip.frames, w) for w in (np.ones_like(inside), inside, ~inside)]
        rows.append(row)
        cells = "".join(f"{v:8.2f}" for v in row)
        print(f"{name:<14}{cells}{len(layers.lights.darkness):8d}{seconds:9.1f}  {scene.composition}", flush=True)
        if a.pictures is not None:
            a.pictures.mkdir(parents=True, exist_ok=True)
            chosen = [0, len(clip.frames) // 2, len(clip.frames) - 1]
            columns = [np.concatenate([clip.frames[t], made.frames[t]]) for t in chosen]
            marked = layers.plate.colour.astype(np.uint8).copy()
            kinds = np.array([(0, 0, 0), (255, 200, 0), (255, 0, 0)], np.uint8)[layers.plate.kind]
            columns.append(np.concatenate([marked, kinds]))
            picture = np.concatenate(columns, axis=1)
            cv2.imwrite(str(a.pictures / f"{name}.png"), picture[..., ::-1])
    if rows:
        print(f"{'mean':<14}" + "".join(f"{v:8.2f}" for v in np.nanmean(rows, axis=0)))


if __name__ == "__main__":
    main()
