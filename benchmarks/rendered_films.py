"""Films that are rendered with what phones and people do to them: shape, frame rate, blur, hands, distance.

The scenes are those of `pipeline.scene.sample_views`, or pendulums; how one is filmed comes from `WAYS`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from benchmarks.hanging_scenes import draw_hanging_scene
from pipeline.clips.draw_views import draw_view_clips, view_kind
from pipeline.clips.schedule import Schedule
from pipeline.scene.scene import Scene, half_extents
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from training.filming import Way, frame_times, poses, seen_by
from training.segmentation.hands import let_go

SUITES = ("films", "joints")  # free bodies; pendulums
UPRIGHT = (360, 640)  # px
SWINGING = 3.0  # s, of a film of a pendulum
SUBFRAMES = 8  # of a blurred frame
DRAWN_FPS = 30  # of the schedule by which scenes are accepted
WAYS = (
    Way("plain, 30", 30),
    Way("upright, 30", 30, UPRIGHT),
    Way("15", 15),
    Way("24, blur", 24, exposure=1 / 48),
    Way("a hand, 30", 30, hand=True),
    Way("far", 30, far=2.5),
    Way("60", 60),
    Way("varying rate", 30, varying=0.3),
    Way("short", 30, seconds=0.3),
    Way("upright, 60, blur", 60, UPRIGHT, exposure=1 / 60),
    Way("29.97", 30000 / 1001),
    Way("25, dim: much blur", 25, exposure=1 / 25),
    Way("near", 30, far=0.7),
    Way("50", 50),
    Way("a hand, upright, 25", 25, UPRIGHT, hand=True, exposure=1 / 100),
    Way("120", 120),
    Way("upright, 24", 24, UPRIGHT),
    Way("far, blur", 30, far=2.0, exposure=1 / 60),
    Way("very short, 60", 60, seconds=0.17),
    Way("3 s", 30, seconds=3.0),
)
SWUNG = tuple(w for w in WAYS if not w.hand and w.seconds == 1.0)


@dataclass(frozen=True)
class Film:
    """A film and its truth.

    Attributes:
        way: How it was filmed.
        kind: Of `pipeline.scene.sample_views.VIEWS`, or "hanging".
        scene: From the moment on at which bodies are free.
        times: (T,) s, of the frames.
        frames: (T, H, W, 3) uint8 RGB.
        masks: (T, H, W) uint8, what is seen of each body: 0 background, i + 1 object i.
    """

    way: Way
    kind: str
    scene: Scene
    times: np.ndarray
    frames: np.ndarray
    masks: np.ndarray


def film_way(index: int, suite: str) -> Way:
    """How the film with this index is made."""
    if suite == "joints":
        return replace(SWUNG[index % len(SWUNG)], seconds=SWINGING)
    return WAYS[index // 5 % len(WAYS)]


def draw_film(seed: int, index: int, suite: str = SUITES[0]) -> Film:
    """The film with this index: its view alternates fastest, then its way.

    Raises:
        DynamicsError: The draw of its scene uses up its tries.
    """
    way = film_way(index, suite)
    if suite == "joints":
        kind = "hanging"
        scene = draw_hanging_scene(clip_rng(seed, suite, index, "sample"), way.seconds)
    else:
        kind = view_kind(index)
        schedule = Schedule(way.seconds, DRAWN_FPS) if way.seconds >= 0.5 else Schedule()
        (scene,) = draw_view_clips(seed, suite, [index], schedule).scenes
    scene = seen_by(scene, way)
    rng = clip_rng(seed, suite, index, "film")
    times, opened = frame_times(rng, way, way.held + way.seconds), way.opened(SUBFRAMES)
    position, quaternion = poses(scene, (times[:, None] + opened).ravel() - way.held)
    appearance = sample_appearance(rng, len(scene.objects), n_fixed=len(scene.fixed))
    frames = render_rgb(scene, position, quaternion, appearance, *way.size, "raycast")
    _draw_rods(frames, scene, position, rng)
    frames = frames.reshape(len(times), len(opened), *frames.shape[1:]).astype(np.float32).mean(1)
    middle = slice(len(opened) // 2, None, len(opened))
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    masks = rasterise(
        scene.objects, position[middle], quaternion[middle], camera, *way.size, scene.ground, fixed=scene.fixed
    ).mask
    if way.hand:
        held, _ = project(position[middle][:, :1], camera, *way.size)
        radius = float(np.sqrt(max((masks == 1).sum((1, 2)).max(), 100) / np.pi))
        masks[let_go(rng, frames, held[:, 0], radius, times, way.held) > 0.5] = 0
    frames = apply_sensor(np.clip(frames, 0, 255).astype(np.uint8), sample_sensor(rng), rng)
    return Film(way, kind, scene, times, frames, masks)


def _draw_rods(frames: np.ndarray, scene: Scene, position: np.ndarray, rng: np.random.Generator) -> None:
    """Draw a thin rod from each anchor to its body. frames: (T, H, W, 3) uint8; position: (T, N, 3) m."""
    assert scene.camera is not None
    height, width = frames.shape[1:3]
    for i, body in enumerate(scene.objects):
        if body.joint is None:
            continue
        rod = np.array(body.joint.anchor) - position[:, i]
        tip = position[:, i] + half_extents(body).min() * rod / np.linalg.norm(rod, axis=1, keepdims=True)
        ends, _ = project(np.stack([position[:, i] + rod, tip], 1), pinhole(scene.camera), width, height)
        colour, thick = tuple(int(c) for c in rng.integers(20, 236, 3)), int(rng.integers(1, 4))
        for frame, (start, end) in zip(frames, np.round(ends * 16).astype(int), strict=True):
            cv2.line(frame, tuple(start.tolist()), tuple(end.tolist()), colour, thick, cv2.LINE_AA, 4)
