"""Clips of the project's own sampler and appearance, by MuJoCo's renderer: what the suites show."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.errors import DynamicsError
from pipeline.physics.simulate import simulate
from pipeline.vision.rendering.appearance import Appearance, apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes
from training.segmentation.clip import DrawnClip, largest_shifts, state_of
from training.segmentation.recording import compressed
from training.segmentation.shadows import label_shadows, with_empty_scene
from training.segmentation.solid_clip import body_radii
from training.segmentation.solid_looks import sample_looks
from training.segmentation.solid_scenes import largest_turns

RENDERED = (480, 320)  # px, width and height
OBJECTS = {1: 0.2, 2: 0.3, 3: 0.3, 4: 0.2}
OWN_LOOK = 0.75  # share of clips with the project's appearance; the others look as the other training clips do


def sample_either_look(rng: np.random.Generator, bodies: int) -> Appearance:
    """The project's appearance of a scene, or that of the other training clips."""
    return sample_appearance(rng, bodies) if rng.random() < OWN_LOOK else sample_looks(rng, bodies)


def sensed(rng: np.random.Generator, frames: np.ndarray) -> np.ndarray:
    """Rendered frames (T, H, W, 3) uint8 with a sensor's noise, half of them compressed as in a video file."""
    frames = apply_sensor(frames, sample_sensor(rng), rng)
    return compressed(frames, int(rng.integers(14, 30))) if rng.random() < 0.5 else frames


def draw_sampled_clip(rng: np.random.Generator, width: int, height: int) -> DrawnClip | None:
    """A random clip of width x height px, its frames with a sensor's noise; None where nothing moves."""
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    seed = int(rng.integers(1 << 31))
    try:
        (scene,) = drawn_scenes(params, seed, "segmentation", range(1), OBJECTS)
        trace = simulate(scene, schedule.seconds)
    except DynamicsError:
        return None
    assert scene.camera is not None
    count = schedule.frames if rng.random() < 0.75 else int(rng.integers(10, schedule.frames + 1))
    at = schedule.frame_steps[:count] if rng.random() < 0.7 else schedule.frame_steps[-count:]
    position, quaternion = trace.position[at], trace.quaternion[at]
    bodies = len(scene.objects)
    look = sample_either_look(rng, bodies)
    camera = pinhole(scene.camera)
    shadows = bool(rng.random() < 0.95)
    rendered = render_rgb(scene, *with_empty_scene(position, quaternion), look, *RENDERED, "mujoco", shadows)
    frames, empty = rendered[:-1], rendered[-1]
    mask = rasterise(scene.objects, position, quaternion, camera, width, height, scene.ground).mask
    centre, depth = project(position, camera, width, height)
    seen = np.stack([(mask == i + 1).any((1, 2)) for i in range(bodies)], 1)
    state = state_of(largest_shifts(centre, seen), largest_turns(quaternion))
    if not ((state == 1) & seen.any(0)).any():
        return None
    small = [cv2.resize(p, (width, height), interpolation=cv2.INTER_AREA) for p in (*frames, empty)]
    other = label_shadows(np.stack(small[:-1]).astype(np.float32), small[-1].astype(np.float32), mask)
    frames = sensed(rng, frames)
    frames = np.stack([cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA) for f in frames])
    radius = body_radii(scene, camera, depth, height)
    centre, radius = centre.astype(np.float32), radius.astype(np.float32)
    return DrawnClip(frames, mask, other, centre, radius, state, recorded=True)
