"""Clips as people film: from any side, near and far, upright, blurred, at any frame rate, with a hand that lets go."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.clips.draw_views import draw_view_clips
from pipeline.clips.schedule import Schedule
from pipeline.errors import DynamicsError
from pipeline.scene.sample_views import VIEWS
from pipeline.vision.rendering.appearance import sample_appearance
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from training.filming import Way, frame_times, poses, seen_by
from training.segmentation.backgrounds import log_uniform
from training.segmentation.clip import MOVES, OTHER, DrawnClip, largest_shifts, state_of
from training.segmentation.hands import let_go
from training.segmentation.sampled_clip import sensed
from training.segmentation.shadows import label_shadows, with_empty_scene
from training.segmentation.solid_clip import body_radii
from training.segmentation.solid_scenes import largest_turns

LARGER = 1.5  # rendered pixels to one of the clip, along a side
SUBFRAMES = 4  # of a blurred frame
MOST_FRAMES = 40
RATES = (15, 24, 25, 30, 50, 60, 120)
UPRIGHT, BLURRED, HANDS = 0.3, 0.3, 0.1  # shares of clips


def sample_way(rng: np.random.Generator, width: int, height: int) -> Way:
    """How a clip is filmed, at width x height px or upright."""
    fps = float(rng.choice(RATES))
    exposure = float(rng.uniform(0.3, 1) / fps) if rng.random() < BLURRED else Way.exposure
    hand = bool(rng.random() < HANDS)
    return Way(
        name="drawn",
        fps=fps,
        size=(height, width) if rng.random() < UPRIGHT else (width, height),
        seconds=min(log_uniform(rng, 0.3, 2.0), MOST_FRAMES / fps),
        exposure=exposure,
        far=log_uniform(rng, 0.7, 2.5),
        hand=hand,
        varying=0.3 if rng.random() < 0.2 else 0.0,
    )


def draw_filmed_clip(rng: np.random.Generator, width: int, height: int) -> DrawnClip | None:
    """A random clip of width x height px, or upright, with a sensor's noise; None where nothing moves in it."""
    way = sample_way(rng, width, height)
    try:
        drawn = draw_view_clips(int(rng.integers(1 << 31)), "segmentation", [int(rng.integers(len(VIEWS)))], Schedule())
    except DynamicsError:
        return None
    scene = seen_by(drawn.scenes[0], way)
    assert scene.camera is not None
    times, opened = frame_times(rng, way, way.held + way.seconds)[-MOST_FRAMES:], way.opened(SUBFRAMES)
    position, quaternion = poses(scene, (times[:, None] + opened).ravel() - way.held)
    look = sample_appearance(rng, len(scene.objects), n_fixed=len(scene.fixed))
    shown = (round(LARGER * way.size[0]), round(LARGER * way.size[1]))
    rendered = render_rgb(scene, *with_empty_scene(position, quaternion), look, *shown, "raycast")
    frames = rendered[:-1].reshape(len(times), len(opened), *rendered.shape[1:]).astype(np.float32).mean(1)
    middle = slice(len(opened) // 2, None, len(opened))
    position, quaternion = position[middle], quaternion[middle]
    camera = pinhole(scene.camera)
    mask = rasterise(scene.objects, position, quaternion, camera, *way.size, scene.ground, fixed=scene.fixed).mask
    centre, depth = project(position, camera, *way.size)
    seen = np.stack([(mask == i + 1).any((1, 2)) for i in range(len(scene.objects))], 1)
    state = state_of(largest_shifts(centre, seen), largest_turns(quaternion))
    if not ((state == MOVES) & seen.any(0)).any():
        return None
    small, empty = _resized(frames, way.size), _resized(rendered[-1:].astype(np.float32), way.size)[0]
    other = label_shadows(small, empty, mask)
    if way.hand:
        held = LARGER * float(np.sqrt(max((mask == 1).sum((1, 2)).max(), 12) / np.pi))
        hand = _resized(let_go(rng, frames, LARGER * centre[:, 0], held, times, way.held), way.size) > 0.5
        mask[hand], other[hand] = 0, OTHER
    recorded = _resized(sensed(rng, np.clip(frames, 0, 255).astype(np.uint8)), way.size)
    radius = body_radii(scene, camera, depth, way.size[1])
    return DrawnClip(recorded, mask, other, centre.astype(np.float32), radius.astype(np.float32), state, recorded=True)


def _resized(pictures: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Pictures (T, H, W) or (T, H, W, 3) in another size, width and height in px."""
    return np.stack([cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pictures])
