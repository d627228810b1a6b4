"""Clips of flat bodies in front of a still picture: side views of throws, inclines and ledges, pucks from above.

Drawn at twice the size, in layers: picture and carriers, passing shadows, the bodies' shadows and mirror images,
bodies, what stands in front, hands and cloth.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from training.segmentation.backgrounds import log_uniform, sample_background, sample_colour, tiles
from training.segmentation.clip import BODY_SHADOW, OTHER, DrawnClip, state_of
from training.segmentation.flat_motion import STEPS_PER_SECOND, FlatMotion, sample_motion
from training.segmentation.hands import (
    draw_cloth,
    draw_hand,
    sample_cloth,
    sample_hand,
    sample_passing_shadow,
)
from training.segmentation.sprites import Sprite, placed, sample_sprite

TWICE = 2
SHADOW = 0.12  # of the light: from here on a shadow is labelled


def sample_times(rng: np.random.Generator) -> tuple[int, float]:
    """A number of frames, and the interval between them, s: 12 to 60 FPS, and slow motion."""
    count = 30 if rng.random() < 0.6 else int(rng.integers(8, 46))
    if rng.random() < 0.7:
        return count, 1 / float(rng.choice([12, 15, 16, 20, 24, 25, 30, 30, 30, 50, 60]))
    return count, log_uniform(rng, 1 / 400, 1 / 40)


def draw_carriers(rng: np.random.Generator, picture: np.ndarray, motion: FlatMotion) -> None:
    """Draw planks, tables, tracks or a floor's edge along the motion's segments on the picture (H, W, 3), in place."""
    height, width = picture.shape[:2]
    for segment in motion.segments:
        a, b = segment * height
        if max(a[1], b[1]) > 1.3 * height or rng.random() < 0.1:
            continue
        if b[0] < a[0]:
            a, b = b, a
        long = b[0] - a[0] > 2.5 * width
        below = np.zeros((height, width), np.float32)
        along = (b - a) / (np.linalg.norm(b - a) + 1e-6)
        down = np.array([-along[1], along[0]])
        thick = height * (2.0 if long and rng.random() < 0.7 else log_uniform(rng, 0.008, 0.12))
        corners = np.round(np.array([a, b, b + thick * down, a + thick * down]) * 16).astype(np.int64)
        cv2.fillPoly(below, [np.clip(corners, -400000, 400000).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
        texture = tiles(rng, width, height) if rng.random() < 0.2 else sample_background(rng, width, height)
        shade = np.linspace(rng.uniform(0.6, 1.2), rng.uniform(0.4, 1.2), height, dtype=np.float32)[:, None, None]
        picture += below[..., None] * (np.clip(texture * shade, 0, 1) - picture)
        if not long:  # what carries it
            for _ in range(int(rng.integers(0, 3))):
                foot = a + rng.uniform(0, 1) * (b - a)
                wide = log_uniform(rng, 0.008, 0.1) * height
                ink = tuple(float(c) for c in sample_colour(rng))
                x, y = round(float(foot[0])), round(float(foot[1] + thick))
                cv2.rectangle(
                    picture, (int(x - wide / 2), y), (int(x + wide / 2), int(height * rng.uniform(0.8, 1.3))), ink, -1
                )


def shadow_offsets(rng: np.random.Generator, kind: str) -> list[tuple[np.ndarray, float, float, float]]:
    """Of each shadow on what is behind: offset in radii (2,), blur in radii, depth, flatness."""
    out = []
    for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.35, 0.4, 0.18, 0.07]))):
        way, far = rng.uniform(0, 2 * math.pi), log_uniform(rng, 0.1, 4.0)
        if kind in ("pucks", "level", "incline") and rng.random() < 0.7:
            far *= 0.2
        elif rng.random() < 0.5:  # on a wall close behind
            far = rng.uniform(1.0, 5.0)
        offset = far * np.array([math.cos(way), math.sin(way)])
        out.append((offset, log_uniform(rng, 0.02, 0.6), float(rng.uniform(0.1, 0.75)), float(rng.uniform(0.5, 1.0))))
    return out


def layer_over(frame: np.ndarray, layer: np.ndarray, where: tuple[slice, slice]) -> None:
    """Put a layer (h, w, 4) over a window of the frame (H, W, 3), in place."""
    alpha = layer[..., 3:]
    frame[where] += alpha * (layer[..., :3] - frame[where])


def _darken(
    frame: np.ndarray, dark: np.ndarray, sprite: Sprite, centre: np.ndarray, radius: float, angle: float, shadows: list
) -> None:
    height, width = frame.shape[:2]
    for offset, soft, depth, _ in shadows:
        found = placed(sprite, centre + offset * radius, radius * 1.02, angle, width, height, (0.0, 0.0))
        if found is None:
            continue
        layer, where = found
        alpha = cv2.GaussianBlur(np.ascontiguousarray(layer[..., 3]), (0, 0), max(soft * radius, 0.4))
        frame[where] *= 1 - depth * alpha[..., None]
        dark[where] |= depth * alpha > SHADOW


def _mirrored(
    frame: np.ndarray,
    other: np.ndarray,
    sprite: Sprite,
    centre: np.ndarray,
    radius: float,
    angle: float,
    line: float,
    strength: float,
    soft: float,
) -> None:
    """Add the image of a body in a glossy surface that begins at row `line`, in place."""
    height, width = frame.shape[:2]
    image = np.array([centre[0], 2 * line - centre[1]])
    found = placed(sprite, image, radius, -angle, width, height, (0.0, 0.0))
    if found is None:
        return
    layer, where = found
    alpha = strength * cv2.GaussianBlur(np.ascontiguousarray(layer[..., 3]), (0, 0), soft)
    alpha *= (np.arange(where[0].start, where[0].stop) >= line)[:, None]
    frame[where] += alpha[..., None] * (cv2.GaussianBlur(layer[..., :3], (0, 0), soft) - frame[where])
    other[where] |= alpha > 0.08


def draw_flat_clip(rng: np.random.Generator, width: int, height: int) -> DrawnClip | None:
    """A random clip of width x height px; None where too little is seen of it."""
    count, interval = sample_times(rng)
    bodies = int(rng.choice([1, 2, 3, 4, 5], p=[0.45, 0.27, 0.14, 0.09, 0.05]))
    big_w, big_h = TWICE * width, TWICE * height
    picture = sample_background(rng, big_w, big_h)
    behind = np.median(picture.reshape(-1, 3)[::97], axis=0)
    sprites = [sample_sprite(rng, 24.0, behind) for _ in range(bodies)]
    seconds = count * interval * float(rng.uniform(1.0, 1.6)) + 0.05
    motion = sample_motion(rng, width / height, np.array([s.round for s in sprites]), seconds)
    first = rng.uniform(0, max(seconds - count * interval - 0.01, 0.0))
    exposed = interval * float(rng.choice([0.0, rng.uniform(0.1, 0.95)], p=[0.35, 0.65]))
    sharp = 1 if exposed == 0 else 3

    def state_at(time: float) -> tuple[np.ndarray, np.ndarray]:
        s = min(time * STEPS_PER_SECOND, len(motion.position) - 1.001)
        k, part = int(s), s - int(s)
        position = (1 - part) * motion.position[k] + part * motion.position[k + 1]
        return position * big_h, (1 - part) * motion.angle[k] + part * motion.angle[k + 1]

    begin = first + interval * np.arange(count)
    centre, angle = (np.stack(v) for v in zip(*(state_at(t + exposed / 2) for t in begin), strict=True))
    radius = motion.radius * big_h
    size = np.minimum(radius, 0.45 * big_h)
    inside = ((centre > -size[:, None] * 0.5) & (centre < np.array([big_w, big_h]) + 0.5 * size[:, None])).all(-1)
    if not (inside.sum(0) >= 3).any():
        return None
    visible = np.array([s.turns_visibly for s in sprites])
    travel = np.linalg.norm(centre[:, None] - centre[None], axis=-1)
    both = inside[:, None] & inside[None]
    shift = np.where(both, travel, 0).max((0, 1)) / TWICE
    turn = np.where(both, np.abs(angle[:, None] - angle[None]), 0).max((0, 1)) * visible
    moves = state_of(shift, np.degrees(turn))
    if not ((moves == 1) & (inside.sum(0) >= 3)).any():
        return None
    # Sprites of the size that they are drawn at, so that small ones are not aliased.
    sprites = [_resampled(s, float(r)) for s, r in zip(sprites, radius, strict=True)]
    draw_carriers(rng, picture, motion)
    shadows = shadow_offsets(rng, motion.kind)
    passing = sample_passing_shadow(rng, big_w, big_h, np.linspace(0, 1, count)) if rng.random() < 0.12 else None
    mirror = float(rng.uniform(0.5, 0.95) * big_h) if rng.random() < 0.2 else None
    strength, soft = float(rng.uniform(0.08, 0.6)), log_uniform(rng, 0.5, 6)
    if mirror is not None and motion.kind in ("level", "throw", "drop", "ledge") and rng.random() < 0.7:
        mirror = float(motion.segments[0][0, 1] * big_h)
    front = _front(rng, big_w, big_h) if rng.random() < 0.15 else None
    times = np.linspace(0, 1, count)
    movers = []
    held = int(np.argmax(motion.release))
    if motion.release[held] > first and rng.random() < 0.75:
        release = (motion.release[held] - first) / (count * interval)
        palm = float(np.clip(radius[held] * log_uniform(rng, 0.5, 2.5), 0.03 * big_h, 0.25 * big_h))
        grip = radius[held] * rng.uniform(0.3, 1.0) * np.array([math.cos(a := rng.uniform(0, 6.3)), math.sin(a)])
        movers.append(
            (sample_hand(rng, big_w, big_h, centre[:, held] + grip, palm, times, release), rng.random() < 0.5)
        )
    if rng.random() < 0.2:
        target = np.zeros((count, 2))
        hand = sample_hand(rng, big_w, big_h, target, log_uniform(rng, 0.03, 0.2) * big_h, times, None)
        movers.append((hand, rng.random() < 0.6))
    cloths = [sample_cloth(rng, big_w, big_h, times) for _ in range(int(rng.random() < 0.1))]
    readout = float(rng.uniform(0, 1)) * (rng.random() < 0.3)
    frames = np.empty((count, height, width, 3), np.float32)
    mask = np.zeros((count, height, width), np.uint8)
    other = np.zeros((count, height, width), np.uint8)
    for t in range(count):
        owner = np.zeros((big_h, big_w), np.uint8)
        moved = np.zeros((big_h, big_w), bool)
        dark = np.zeros((big_h, big_w), bool)
        frame = picture if passing is None else picture * passing[t]
        total = np.zeros((big_h, big_w, 3), np.float32)
        hands = [(draw_hand(hand, t, big_w, big_h), over) for hand, over in movers]
        for part in range(sharp):
            now = frame.copy()
            position, angles = state_at(begin[t] + exposed * (part + 0.5) / sharp)
            for i, sprite in enumerate(sprites):
                _darken(now, dark, sprite, position[i], radius[i], angles[i], shadows)
            if mirror is not None:
                for i, sprite in enumerate(sprites):
                    _mirrored(now, moved, sprite, position[i], radius[i], angles[i], mirror, strength, soft)
            for layer, over in hands:
                if not over:
                    layer_over(now, layer, (slice(None), slice(None)))
            for i, sprite in enumerate(sprites):
                before, _ = state_at(max(begin[t] - interval, 0.0))
                shear = (position[i] - before[i]) * readout * 2 * radius[i] / big_h
                found = placed(
                    sprite, position[i], radius[i], angles[i], big_w, big_h, (float(shear[0]), float(shear[1]))
                )
                if found is None:
                    continue
                layer, where = found
                layer_over(now, layer, where)
                if part == sharp // 2:
                    owner[where][layer[..., 3] > 0.5] = i + 1
            total += now
        frame = total / sharp
        for layer, over in hands:
            if not over:
                moved |= (layer[..., 3] > 0.5) & (owner == 0)
        tops = [front] if front is not None else []
        for layer in [
            *tops,
            *(layer for layer, over in hands if over),
            *(draw_cloth(c, t, big_w, big_h) for c in cloths),
        ]:
            layer_over(frame, layer, (slice(None), slice(None)))
            covered = layer[..., 3] > 0.5
            owner[covered] = 0
            moved = moved & ~covered if layer is front else moved | covered
        moved[owner > 0] = False
        dark[(owner > 0) | moved] = False
        frames[t] = 255 * cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
        mask[t] = _halved(owner, bodies)
        for label, shown in ((BODY_SHADOW, dark), (OTHER, moved)):
            other[t][cv2.resize(shown.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.5] = label
        other[t][mask[t] > 0] = 0
    seen = np.stack([(mask == i + 1).sum((1, 2)) for i in range(bodies)], 1)
    if not ((moves == 1) & ((seen >= 4).sum(0) >= 3)).any():
        return None
    return DrawnClip(
        frames, mask, other, centre / TWICE, np.broadcast_to(radius / TWICE, (count, bodies)).copy(), moves
    )


def _resampled(sprite: Sprite, radius: float) -> Sprite:
    """The sprite with its pictures at the size at which it is drawn."""
    scale = radius / sprite.unit
    size = max(round(sprite.picture.shape[0] * scale / 2) * 2, 4)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    grown = [cv2.resize(p, (size, size), interpolation=how) for p in (sprite.picture, sprite.alpha, sprite.shading)]
    unit = sprite.unit * size / sprite.picture.shape[0]
    return Sprite(
        picture=np.clip(grown[0], 0, 1),
        alpha=np.clip(grown[1], 0, 1),
        shading=grown[2],
        unit=unit,
        round=sprite.round,
        turns_visibly=sprite.turns_visibly,
        reach=sprite.reach,
    )


def _front(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """A still layer (H, W, 4) that stands in front: a rod, a frame, a box."""
    alpha = np.zeros((height, width), np.float32)
    for _ in range(int(rng.integers(1, 3))):
        x, y = float(rng.uniform(0, width)), float(rng.uniform(0, height))
        if rng.random() < 0.6:
            wide, lean = int(log_uniform(rng, 3, 30)), float(rng.normal(0, 0.1 * height))
            ends = (
                [(int(x), -5), (int(x + lean), height + 5)]
                if rng.random() < 0.6
                else [(-5, int(y)), (width + 5, int(y + lean))]
            )
            cv2.line(alpha, ends[0], ends[1], 1.0, wide, cv2.LINE_AA)
        else:
            w, h = log_uniform(rng, 8, 120), log_uniform(rng, 8, 120)
            cv2.fillPoly(
                alpha, [cv2.boxPoints(((x, y), (w, h), float(rng.uniform(0, 90)))).astype(np.int32)], 1.0, cv2.LINE_AA
            )
    return np.concatenate([sample_background(rng, width, height), alpha[..., None]], -1)


def _halved(owner: np.ndarray, bodies: int) -> np.ndarray:
    """Ids (H, W) of ids (2 H, 2 W): the body with most of the four pixels, where it has two or more."""
    height, width = owner.shape[0] // 2, owner.shape[1] // 2
    four = owner.reshape(height, 2, width, 2).transpose(0, 2, 1, 3).reshape(height, width, 4)
    votes = np.stack([(four == i + 1).sum(-1) for i in range(bodies)], -1)
    best = votes.argmax(-1)
    return np.where(votes.max(-1) >= 2, best + 1, 0).astype(np.uint8)
