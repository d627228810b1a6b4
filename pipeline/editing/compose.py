"""Pictures of an edited motion, from the layers of a clip.

A pixel that the edit does not touch is the clip's own. Where a body or its shadow is no longer as it was filmed, or
another one is, the picture is made of the plate, of shadows and of the bodies' textures, with the clip's noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.editing import plate as plates
from pipeline.editing import surface_texture
from pipeline.editing.camera_rays import NOBODY
from pipeline.editing.drawing import Drawn, draw
from pipeline.editing.edit_list import Colour
from pipeline.editing.exposure import blurred, draw_exposed, made_faster, paths_px
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.in_threads import in_threads
from pipeline.editing.layers import Layers
from pipeline.editing.light import ground_light
from pipeline.editing.registration import identity
from pipeline.editing.surface_texture import SIZE, Textures, plain_texture, unturned
from pipeline.editing.texture_views import Pose, nearness, texture_near
from pipeline.editing.view import BodyMotion, within_px
from pipeline.vision.rendering.appearance import object_colour

SAME_PX = 0.1  # a body that is shown this close to where it was filmed is left as it was filmed
SHADOW_CHANGE = 0.004  # of the light on the ground, from which on a pixel is touched
RIM_PX = 3  # around bodies that are no longer there
DARKER = 3.0  # standard deviations of the noise, and
LEAST_CHANGE = 4.0  # of 255: a pixel near a body that differs so much from the plate shows its shadow or reflection
NEAR = 1.0  # how near: in the body's own size


@dataclass(frozen=True)
class EditedFrames:
    """The pictures, and where what they show comes from.

    Attributes:
        frames: (T, H, W, 3) uint8.
        ids: (T, H, W) uint8: 0 background, i + 1 body i of the edited motion.
        bodies: Shares of the bodies' shown pixels: measured, mirrored, invented.
        background: Shares of the background's shown pixels: measured, repaired, invented.
    """

    frames: np.ndarray
    ids: np.ndarray
    bodies: tuple[float, float, float]
    background: tuple[float, float, float]


def compose(
    clip: FilmedClip,
    layers: Layers,
    edited: BodyMotion,
    origin: tuple[int | None, ...],
    start: int,
    rng: np.random.Generator,
    redraw: bool = False,
    colours: Sequence[Colour | None] = (),
) -> EditedFrames:
    """Show an edited motion.

    Args:
        clip: T frames with the bodies of `layers.motion`.
        layers: The clip taken apart.
        edited: T frames, M bodies.
        origin: (M,) which body of the clip each of them is; None for a new one.
        start: First frame that may differ from the clip's.
        rng: Of the noise.
        redraw: Make every pixel from the layers, also those that the edit does not touch; textures then come from the
            other frames.
        colours: (M,) RGB of new bodies, from 0 to 255, where it is said; none where none is.

    Returns:
        The pictures.
    """
    as_filmed, corrections = follow(layers, edited, origin, start, redraw)
    said = [object_colour(m) if m >= len(colours) else colours[m] or object_colour(m) for m in range(len(origin))]
    parts = [
        plain_texture(said[m]) if o is None else (layers.textures.colour[o], layers.textures.kind[o])
        for m, o in enumerate(origin)
    ]
    texture = np.stack([p[0] for p in parts]) if parts else np.zeros((0, 6, SIZE, SIZE, 3), np.float32)
    kind = np.stack([p[1] for p in parts]) if parts else np.zeros((0, 6, SIZE, SIZE), np.uint8)
    turned = unturned(edited, [o is not None and layers.same_all_around[o] for o in origin])
    frames, ids = clip.frames.copy(), np.zeros(clip.masks.shape, np.uint8)
    rectangles, noises = edited.rectangles(layers.view), rng.spawn(len(frames))
    paths, filmed = (layers.exposure.shutter * paths_px(c) for c in (corrections, layers.corrections))
    faster = made_faster(paths, filmed, origin)

    def show(t: int) -> tuple[np.ndarray, np.ndarray]:
        """Write frame t; the counts of its pixels by kind, of bodies and of the background."""
        if t < start and not redraw:
            ids[t] = np.where(clip.masks[t] <= len(layers.motion.objects), clip.masks[t], 0)
            bodies = int((ids[t] > 0).sum())
            return np.array([bodies, 0, 0]), np.array([ids[t].size - bodies, 0, 0])
        own_texture = texture.copy()
        for m in np.flatnonzero(edited.shown[t]):
            if (o := origin[m]) is not None:
                own_texture[m] = _texture_at(layers, o, turned.quaternion[t, m], corrections[t, m], t, redraw)
        textures, shown = Textures(own_texture, kind), edited.shown[t]

        def draw_at(moved: np.ndarray) -> Drawn:
            return draw(layers.view, turned.tables[t], moved, rectangles[t], shown, textures, layers.lights)

        drawn = draw_exposed(draw_at, corrections[t], shown, paths=paths[t], faster=faster[t])
        light = ground_light(edited, layers.view, corrections, t, layers.lights)
        touched = np.ones(clip.masks.shape[1:], bool)
        if not redraw:
            touched = _touched(clip, layers, edited, origin, as_filmed[t], light, drawn, t)
        colour, alpha = blurred(drawn, layers.exposure.blur)
        picture = layers.plate.colour * light.astype(np.float32)[..., None]
        picture += alpha[..., None] * (colour - picture)
        picture += layers.plate.noise * noises[t].standard_normal(picture.shape, dtype=np.float32)
        own = drawn.front != NOBODY
        kept = np.zeros_like(touched)
        for m in np.flatnonzero(as_filmed[t]):
            kept |= (drawn.front == m) & (drawn.alpha >= 1) & (clip.masks[t] == _origin(origin, int(m)) + 1)
        use = touched & ~(kept & (not redraw))
        frames[t][use] = np.clip(picture[use] + 0.5, 0, 255).astype(np.uint8)
        ids[t][own] = drawn.front[own] + 1
        return (
            np.bincount(np.where(use, drawn.kinds, surface_texture.MEASURED)[own], minlength=3),
            np.bincount(np.where(use, layers.plate.kind, plates.MEASURED)[~own], minlength=3),
        )

    counts = in_threads(show, range(len(frames)))
    return EditedFrames(
        frames, ids, _shares(np.sum([c[0] for c in counts], 0)), _shares(np.sum([c[1] for c in counts], 0))
    )


def follow(
    layers: Layers, edited: BodyMotion, origin: tuple[int | None, ...], start: int, redraw: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Which bodies are where they were filmed, (T, M) bool, and the corrections (T, M, 5) of the edited motion.

    A body has the clip's own correction as long as it moves as filmed. From then on it has the last of these, and the
    one of each frame as far as it is still near to where the scene has it in that frame of the clip: the scene's error
    is alike there.
    """
    frames, count = edited.shown.shape
    same = np.zeros((frames, count), bool)
    known = [m for m, o in enumerate(origin) if o is not None]
    part = layers.motion.only([o for o in origin if o is not None])
    same[:, known] = within_px(part, edited.only(known), layers.view, SAME_PX)
    for k, m in enumerate(known):
        if edited.objects[m].size != part.objects[k].size or edited.objects[m].shape != part.objects[k].shape:
            same[:, m] = False
    together = np.logical_and.accumulate(same[start:], axis=0)  # once apart, a body is not the filmed one again
    same[start:] = together
    corrections = identity(edited, layers.view)
    boxes = edited.rectangles(layers.view)
    for m in known:
        own, last = layers.corrections[:, _origin(origin, m)], max(start - 1, 0)
        for t in range(frames):
            if t < start or same[t, m]:
                last = t
            apart = float(np.linalg.norm(corrections[t, m, :2] - own[t, :2]))
            size = max(boxes[t, m, 1] - boxes[t, m, 0], boxes[t, m, 3] - boxes[t, m, 2], 1.0)
            near = math.exp(-0.5 * (apart / size) ** 2)
            corrections[t, m, 2:] = near * own[t, 2:] + (1 - near) * own[last, 2:]
    return same & (not redraw), corrections


def _texture_at(
    layers: Layers, body: int, quaternion: np.ndarray, correction: np.ndarray, t: int, others: bool
) -> np.ndarray:
    """(6, S, S, 3) the texture of a body of the clip for a pose in frame t; `others`: without that frame's own."""
    seen, mean = layers.textures.seen[body], layers.textures.colour[body]
    use = seen.frames != t if others else np.ones(len(seen.frames), bool)
    if not use.any():
        return mean
    filmed, drawn = layers.corrections[seen.frames, body], layers.drawn.quaternion[seen.frames, body]
    poses = Pose(drawn, filmed[:, :2] + filmed[:, 2:4], seen.frames)
    pose = Pose(quaternion, correction[:2] + correction[2:4], np.array(t))
    near = np.where(use, nearness(poses, pose, layers.view.ray_arguments[2]), 0)
    return texture_near(mean, seen, near / near.max())


def _touched(
    clip: FilmedClip,
    layers: Layers,
    edited: BodyMotion,
    origin: tuple[int | None, ...],
    as_filmed: np.ndarray,
    light: np.ndarray,
    drawn: Drawn,
    t: int,
) -> np.ndarray:
    """(H, W) bool: where the clip no longer shows what is there."""
    kept = {_origin(origin, int(m)) for m in np.flatnonzero(as_filmed)}
    gone = [i for i in range(len(layers.motion.objects)) if i not in kept and layers.motion.shown[t, i]]
    moved = [m for m in range(len(origin)) if not as_filmed[m] and edited.shown[t, m]]
    out = np.zeros(clip.masks.shape[1:], bool)
    if not gone and not moved:
        return out
    rim = 1 + math.ceil(2 * layers.exposure.blur)
    for m in moved:
        out |= plates.grown(drawn.cover[m][None], rim)[0]
    differs = np.abs(clip.frames[t].astype(np.float32) - layers.plate.colour).max(-1)
    differs = cv2.blur(differs, (3, 3)) > max(LEAST_CHANGE, DARKER * layers.plate.noise)
    for i in gone:
        mask = clip.masks[t] == i + 1
        size = int(np.sqrt(mask.sum() / np.pi) * 2 * NEAR) + RIM_PX
        out |= plates.grown(mask[None], RIM_PX)[0] | (plates.grown(mask[None], size)[0] & differs)
    before = ground_light(layers.motion, layers.view, layers.corrections, t, layers.lights)
    changed = np.abs(light - before) > SHADOW_CHANGE
    out |= plates.grown(changed[None], 2)[0]
    return out


def _origin(origin: tuple[int | None, ...], m: int) -> int:
    found = origin[m]
    assert found is not None
    return found


def _shares(counts: np.ndarray) -> tuple[float, float, float]:
    total = max(float(counts.sum()), 1.0)
    return float(counts[0]) / total, float(counts[1]) / total, float(counts[2]) / total
