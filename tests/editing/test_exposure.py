"""Laws of the exposure: how long the shutter was open is found in the blur of moving edges, and drawn again."""

from dataclasses import replace

import filmed
import numpy as np
import small_clip

from pipeline.clips.replay import replay
from pipeline.clips.schedule import Schedule
from pipeline.editing.compose import compose
from pipeline.editing.edited_motion import filmed_motion
from pipeline.editing.exposure import paths_px
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.layers import Layers, take_apart
from pipeline.editing.view import BodyMotion, view_of
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_rgb

TIMES = 8  # pictures for each frame
FRAMES, FPS = 12, 30


def scene() -> Scene:
    """A ball that flies past without touching anything."""
    whole = small_clip.scene()
    ball = replace(whole.objects[0], position=(-0.7, 0.0, 0.4), velocity=(3.0, 0.0, 1.5), angular_velocity=(0.0,) * 3)
    return replace(whole, objects=(ball,))


def blurred_clip(shutter: float) -> FilmedClip:
    """The frames are the mean over the pictures while the shutter is open; masks are those of its middle."""
    run = replay(scene(), Schedule(FRAMES / FPS, FPS * TIMES, 10), small_clip.WIDTH, small_clip.HEIGHT)
    size = small_clip.WIDTH, small_clip.HEIGHT
    pictures = render_rgb(scene(), run.position, run.quaternion, plain_appearance(1), *size, "raycast")
    half = round(shutter * TIMES / 2)
    middle = np.arange(FRAMES) * TIMES
    spans = [pictures[max(t - half, 0) : t + half + 1].astype(float).mean(0) for t in middle]
    return FilmedClip(np.rint(spans).astype(np.uint8), run.masks[middle], np.arange(FRAMES) / FPS)


def taken_apart(shutter: float) -> tuple[FilmedClip, BodyMotion, Layers]:
    clip, (motion, _) = blurred_clip(shutter), filmed_motion(scene(), np.arange(FRAMES) / FPS)
    return clip, motion, take_apart(clip, motion, view_of(scene(), small_clip.WIDTH, small_clip.HEIGHT))


def test_sharp_pictures_of_fast_bodies_have_no_shutter() -> None:
    assert taken_apart(0.0)[2].exposure.shutter == 0


def test_pictures_of_slow_bodies_have_none_either() -> None:
    assert filmed.layers().exposure.shutter == 0


def test_a_shutter_is_found_and_drawn_again() -> None:
    clip, motion, layers = taken_apart(0.5)
    assert layers.exposure.shutter in (0.5, 0.75)
    made = compose(clip, layers, motion, (0,), 0, np.random.default_rng(0), redraw=True)
    sharp = replace(layers, exposure=replace(layers.exposure, shutter=0.0))
    without = compose(clip, sharp, motion, (0,), 0, np.random.default_rng(0), redraw=True)
    where = np.abs(clip.frames.astype(int) - blurred_clip(0.0).frames).max(-1) > 8
    gain = filmed.psnr(made.frames, clip.frames, where) - filmed.psnr(without.frames, clip.frames, where)
    assert where.sum() > 500 and gain > 3


def test_a_body_that_is_put_elsewhere_has_no_path_there() -> None:
    corrections = np.zeros((6, 1, 5))
    corrections[:, 0, 0] = [0, 2, 4, 100, 102, 104]
    np.testing.assert_array_equal(paths_px(corrections)[:, 0, 0], [2] * 6)
