"""Clips rendered twice, before and after a true edit: how near edited clips come to the second, given the true scene.

    python -m benchmarks.paired_edits --clips 14 --pictures FOLDER

Each line is a clip: PSNR (dB) against the true edited clip, inside of the bodies' masks in either clip, of the edited
clip, of the clip without any edit, and of primitives in plain colours; and IoU of the edited and the true masks.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from benchmarks.edits import psnr
from pipeline.clips.schedule import Schedule
from pipeline.editing.compose import compose
from pipeline.editing.edit_list import Edit
from pipeline.editing.edited_motion import EditedMotion, filmed_motion, frame_steps, run_edits
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.layers import take_apart
from pipeline.editing.view import BodyMotion, view_of
from pipeline.errors import SceneError
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene, SceneObject
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.appearance import (
    Appearance,
    Sensor,
    apply_sensor,
    plain_appearance,
    sample_appearance,
    sample_sensor,
)
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

SUITE = "paired_edits"
OBJECTS = {1: 1.0, 2: 1.0, 3: 1.0}
KINDS = ("mass", "friction", "velocity", "gravity", "remove", "add", "later")
TRIES = 20  # of an edit that puts a body into another, or changes nothing
LEAST_CHANGE_M = 0.05  # of a body's place, from which on an edit counts


def draw_edit(kind: str, scene: Scene, rng: np.random.Generator) -> Edit:
    """An edit of one kind with random numbers."""
    k = int(rng.integers(len(scene.objects)))
    obj = scene.objects[k]
    if kind == "mass":
        return Edit(0.0, set=f"objects[{k}].mass={obj.mass * rng.choice([0.1, 10]):g}")
    if kind == "friction":
        return Edit(0.0, set=f"objects[{k}].sliding_friction={rng.choice([0.0, 2.0]):g}")
    if kind == "gravity":
        return Edit(0.0, set=f"gravity={rng.uniform(1, 4):.3g}")
    if kind == "remove":
        return Edit(0.0, remove=obj.name)
    if kind == "add":
        place = [float(v) for v in (rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), 0.6)]
        keys = {"mass": 0.5, "sliding_friction": 0.5, "rolling_friction": 0.001, "damping": 0.7}
        still = {"velocity": [0.0] * 3, "angular_velocity": [0.0] * 3, "orientation": [1.0, 0.0, 0.0, 0.0]}
        return Edit(0.0, add={"name": "added", "shape": "sphere", "radius": 0.1, **keys, "position": place, **still})
    velocity = [round(float(v), 3) for v in (*rng.uniform(-1.5, 1.5, 2), rng.uniform(0, 2))]
    return Edit(0.4 if kind == "later" else 0.0, set=f"objects[{k}].velocity={velocity}")


def shown_bodies(motion: BodyMotion) -> BodyMotion:
    """The bodies that are there in the last frame; an edit at the beginning has no others."""
    there = motion.shown[-1]
    return BodyMotion(
        tuple(o for o, kept in zip(motion.objects, there, strict=True) if kept),
        motion.position[:, there],
        motion.quaternion[:, there],
        motion.shown[:, there],
    )


def filmed(
    scene: Scene, motion: BodyMotion, look: Appearance, sensor: Sensor, size: tuple[int, int], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Frames (T, H, W, 3) and masks (T, H, W) of a motion before a scene's camera."""
    assert scene.camera is not None
    bodies = replace(scene, objects=motion.objects)
    frames = render_rgb(bodies, motion.position, motion.quaternion, look, *size, "mujoco")
    pose = motion.position, motion.quaternion, pinhole(scene.camera)
    return apply_sensor(frames, sensor, rng), rasterise(motion.objects, *pose, *size, scene.ground).mask


def look_of(objects: tuple[SceneObject, ...], names: list[str], look: Appearance) -> Appearance:
    """The appearance of these objects; those that are not among `names` are plain."""
    plain = plain_appearance(len(names) + 1).materials[-1]
    materials = tuple(look.materials[names.index(o.name)] if o.name in names else plain for o in objects)
    return replace(look, materials=materials)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=14, metavar="N")
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--size", type=int, nargs=2, default=(240, 160), metavar=("W", "H"))
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    a = parser.parse_args()
    params, schedule, size = read_params_file(PARAMS_FILE, Params), Schedule(), tuple(a.size)
    print(f"{'clip':<6}{'edit':<10}{'edited':>8}{'no edit':>9}{'plain':>8}{'IoU':>7}")
    rows = []
    for index in range(a.clips):
        kind = KINDS[index % len(KINDS)]
        (scene,) = drawn_scenes(params, a.seed, SUITE, range(index, index + 1), OBJECTS)
        rng = clip_rng(a.seed, SUITE, index, "edit")
        motion, trace = filmed_motion(scene, schedule.frames, schedule.fps)
        look, sensor = sample_appearance(rng, len(scene.objects)), sample_sensor(rng)
        frames, masks = filmed(scene, motion, look, sensor, size, rng)
        made_motion = _edited(kind, scene, trace, schedule, rng)
        if made_motion is None:
            continue
        after = shown_bodies(made_motion.motion)
        names = [o.name for o in scene.objects]
        changed = replace(scene, gravity=made_motion.scene.gravity)
        true, true_masks = filmed(changed, after, look_of(after.objects, names, look), sensor, size, rng)
        plain, _ = filmed(changed, after, plain_appearance(len(after.objects)), Sensor(), size, rng)
        clip = FilmedClip(frames, masks, schedule.fps)
        layers = take_apart(clip, motion, view_of(scene, *size))
        noise = np.random.default_rng(0)
        made = compose(clip, layers, made_motion.motion, made_motion.origin, made_motion.first, noise)
        either = (masks > 0) | (true_masks > 0)
        overlap = ((made.ids > 0) & (true_masks > 0)).sum() / max(((made.ids > 0) | (true_masks > 0)).sum(), 1)
        row = [psnr(made.frames, true, either), psnr(frames, true, either), psnr(plain, true, either), float(overlap)]
        rows.append(row)
        print(f"{index:<6}{kind:<10}{row[0]:8.2f}{row[1]:9.2f}{row[2]:8.2f}{row[3]:7.3f}", flush=True)
        if a.pictures is not None:
            a.pictures.mkdir(parents=True, exist_ok=True)
            columns = [np.concatenate([frames[t], made.frames[t], true[t]]) for t in (0, 10, 20, 29)]
            cv2.imwrite(str(a.pictures / f"{index:02d}_{kind}.png"), np.concatenate(columns, axis=1)[..., ::-1])
    mean = np.mean(rows, axis=0)
    print(f"{'mean':<16}{mean[0]:8.2f}{mean[1]:9.2f}{mean[2]:8.2f}{mean[3]:7.3f}")


def _edited(kind: str, scene: Scene, trace: Trace, schedule: Schedule, rng: np.random.Generator) -> EditedMotion | None:
    """The motion after a drawn edit that is possible and changes it; None where there is none, as mass without hits."""
    steps = frame_steps(schedule.frames, schedule.fps)
    for _ in range(TRIES):
        try:
            made = run_edits(scene, trace, [draw_edit(kind, scene, rng)], schedule.frames, schedule.fps)
        except SceneError:
            continue
        count = len(scene.objects)
        apart = np.linalg.norm(made.motion.position[:, :count] - trace.position[steps], axis=-1)
        if apart.max() > LEAST_CHANGE_M or not made.motion.shown.all():
            return made
    return None


if __name__ == "__main__":
    main()
