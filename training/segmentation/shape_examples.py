"""Squares around bodies of rendered scenes, with their shapes, made once and kept.

    python -m training.segmentation.shape_examples OUT [--scenes 8000] [--first 0] [--seed 41]

OUT: a folder of .npz files with the arrays of `ShapeExamples`, SHARD scenes each. Scene i depends on the seed and i
alone; a file that is already there is skipped, so a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from pipeline.bodies.networks.body_shapes import tells_its_shape
from pipeline.bodies.networks.outlines import square_around
from pipeline.errors import DynamicsError
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import BASIC_SHAPES, SceneObject
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes
from training.segmentation.kept_arrays import load_arrays, save_arrays
from training.segmentation.outline_examples import jittered
from training.segmentation.recording import recorded
from training.segmentation.sampled_clip import OBJECTS, RENDERED, sample_either_look, sensed
from training.segmentation.solid_clip import poses_at, render
from training.segmentation.solid_looks import sample_looks
from training.segmentation.solid_scenes import draw_moving_scene, sample_camera

SHARD = 100  # scenes of a file
FRAMES = 4  # of a scene
SAMPLED = 0.6  # share of scenes of the project's own sampler; the others are seen from anywhere
WIDER = (360, 240)  # px, width and height, of the scenes that are seen from anywhere


@dataclass(frozen=True)
class ShapeExamples:
    """N squares. frame: (N, SIDE, SIDE, 3) uint8. mask, others: (N, SIDE, SIDE) uint8, 255 where the body is, where
    another one is. shape: (N,) index into BASIC_SHAPES. body: (N, 2) int32, the scene and the object in it."""

    frame: np.ndarray
    mask: np.ndarray
    others: np.ndarray
    shape: np.ndarray
    body: np.ndarray


def _sampled_scene(rng: np.random.Generator, params: Params) -> tuple[np.ndarray, np.ndarray, Sequence[SceneObject]]:
    """Frames, masks and objects of a scene of the project's sampler; raises DynamicsError."""
    schedule = params.clip.schedule
    (scene,) = drawn_scenes(params, int(rng.integers(1 << 31)), "shapes", range(1), OBJECTS)
    trace = simulate(scene, schedule.seconds)
    at = np.sort(rng.choice(schedule.frame_steps, FRAMES, replace=False))
    position, quaternion = trace.position[at], trace.quaternion[at]
    bodies = len(scene.objects)
    look = sample_either_look(rng, bodies)
    frames = render_rgb(scene, position, quaternion, look, *RENDERED, "mujoco", bool(rng.random() < 0.95))
    frames = sensed(rng, frames)
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    return frames, rasterise(scene.objects, position, quaternion, camera, *RENDERED, scene.ground).mask, scene.objects


def _scene_from_anywhere(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, Sequence[SceneObject]] | None:
    """Frames, masks and objects of a scene that a camera sees from anywhere; None where it fails."""
    drawn = draw_moving_scene(rng, 1.0)
    if drawn is None:
        return None
    scene, trace, tilt = drawn
    position, quaternion = poses_at(trace, np.sort(rng.uniform(0, len(trace.position) - 1, FRAMES)))
    camera = sample_camera(rng, scene, position, tilt)
    if camera.position_world[2] < 0.1:
        return None
    look, shadows = sample_looks(rng, len(scene.objects)), bool(rng.random() < 0.9)
    frames = render(scene, position, quaternion, camera, look, *WIDER, bool(rng.random() < 0.75), shadows)
    masks = rasterise(scene.objects, position, quaternion, camera, *WIDER, scene.ground).mask
    return recorded(rng, frames), masks, scene.objects


def examples_of(rng: np.random.Generator, index: int, params: Params) -> ShapeExamples | None:
    """The squares of scene `index`; None where it fails or shows too little."""
    try:
        drawn = _sampled_scene(rng, params) if rng.random() < SAMPLED else _scene_from_anywhere(rng)
    except DynamicsError:
        return None
    if drawn is None:
        return None
    frames, masks, objects = drawn
    rows = []
    for frame, ids in zip(frames, masks, strict=True):
        for i, obj in enumerate(objects):
            own = ids == i + 1
            if not tells_its_shape(own):
                continue
            square = jittered(rng, square_around(own))
            parts = [np.round(255 * square.cut(m)).astype(np.uint8) for m in (own, (ids > 0) & ~own)]
            rows.append((square.cut(frame), *parts, BASIC_SHAPES.index(obj.shape), (index, i)))
    if not rows:
        return None
    frame, mask, others, shape, body = zip(*rows, strict=True)
    pictures = {"frame": np.stack(frame), "mask": np.stack(mask), "others": np.stack(others)}
    return ShapeExamples(**pictures, shape=np.array(shape), body=np.array(body, np.int32))


def joined(parts: Sequence[ShapeExamples]) -> ShapeExamples:
    return ShapeExamples(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(ShapeExamples)))


def load_examples(folder: Path) -> ShapeExamples:
    """All examples of a folder."""
    return joined([load_arrays(path, ShapeExamples) for path in sorted(folder.glob("*.npz"))])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=8000)
    parser.add_argument("--first", type=int, default=0, help="scene; a multiple of the scenes of a file")
    parser.add_argument("--seed", type=int, default=41)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    params = read_params_file(PARAMS_FILE, Params)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for first in tqdm(range(arguments.first, arguments.first + arguments.scenes, SHARD), disable=None):
        path = arguments.out / f"{first:06d}.npz"
        if path.exists():
            continue
        made = [examples_of(np.random.default_rng([arguments.seed, i]), i, params) for i in range(first, first + SHARD)]
        save_arrays(path, joined([m for m in made if m is not None]))


if __name__ == "__main__":
    main()
