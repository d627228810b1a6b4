"""Things that move and are not bodies: hands with sleeves, cloth, and soft shadows of something out of view.

A hand is an arm, a palm and fingers of capsules that reaches in from the border. Everything is drawn as a layer
(H, W, 4): RGB in [0, 1] and opacity.
"""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass

import cv2
import numpy as np

from training.segmentation.backgrounds import fractal_noise, log_uniform, sample_background, sample_colour


@dataclass(frozen=True)
class Hand:
    """One hand over a clip. base: (2,) px, where the arm begins, outside the picture. wrist: (T, 2) px. spread: (T,)
    radians between neighbouring fingers. palm: its radius, px. lengths: (5,) of the fingers, in palms. bend: (T, 5)
    radians at the fingers' middle joint. skin, sleeve: textures (h, w, 3). sleeve_from: share of the arm, from the
    wrist, that is bare. mirrored: -1 or 1."""

    base: np.ndarray
    wrist: np.ndarray
    spread: np.ndarray
    palm: float
    lengths: np.ndarray
    bend: np.ndarray
    skin: np.ndarray
    sleeve: np.ndarray
    sleeve_from: float
    mirrored: float
    light: np.ndarray


def smooth_path(points: np.ndarray, times: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(T, D): through points (K, D) at their times (K,), with a smooth start and stop at each."""
    out = np.empty((len(at), points.shape[1]))
    for i, t in enumerate(at):
        k = int(np.clip(np.searchsorted(times, t) - 1, 0, len(times) - 2))
        s = float(np.clip((t - times[k]) / max(times[k + 1] - times[k], 1e-6), 0, 1))
        s = s * s * (3 - 2 * s)
        out[i] = points[k] + s * (points[k + 1] - points[k])
    return out


def sample_skin(rng: np.random.Generator) -> np.ndarray:
    """RGB (3,): skin from pale to dark, under a light of any warmth; sometimes a glove."""
    if rng.random() < 0.08:
        return sample_colour(rng)
    skin = colorsys.hsv_to_rgb(rng.uniform(0.0, 0.1), rng.uniform(0.15, 0.7), rng.uniform(0.2, 1.0))
    return np.clip(np.array(skin) * rng.uniform(0.85, 1.1, 3), 0, 1).astype(np.float32)


def sample_hand(
    rng: np.random.Generator,
    width: int,
    height: int,
    target: np.ndarray,
    palm: float,
    times: np.ndarray,
    release: float | None,
) -> Hand:
    """A hand whose finger tips are at target (T, 2), px, until `release`, and then withdraws; or moves freely (None).

    times: (T,) of the frames in [0, 1]. palm: radius, px.
    """
    side = int(rng.integers(4))
    along = rng.uniform(-0.1, 1.1)
    base = np.array([[-0.3, along], [1.3, along], [along, -0.4], [along, 1.4]][side]) * [width, height]
    count = len(times)
    lengths = rng.uniform(1.2, 2.2, 5)
    reach = palm * (0.9 + 0.75 * lengths[1:4].mean())

    def wrist_for(tip: np.ndarray) -> np.ndarray:
        way = tip - base
        return tip - way / (np.linalg.norm(way, axis=-1, keepdims=True) + 1e-6) * reach

    if release is None:
        knots = int(rng.integers(2, 6))
        middle = np.array([width, height]) * rng.uniform(0.1, 0.9, (knots, 2))
        near = rng.uniform(0.0, 1.0, (knots, 1)) ** log_uniform(rng, 0.3, 3)
        wrist = smooth_path(base + near * (middle - base), np.sort(rng.uniform(-0.3, 1.3, knots)), times)
        opening = smooth_path(rng.uniform(0.02, 0.4, (knots, 1)), np.linspace(0, 1, knots), times)[:, 0]
    else:
        wrist = wrist_for(target)
        gone = max(rng.uniform(0.1, 0.6), 1e-3)
        start = wrist[int(np.argmin(np.abs(times - release)))]
        share = rng.uniform(0.05, 1.0)
        s = np.clip((times - release) / gone, 0, 1)[:, None]
        away = start + (s * s * (3 - 2 * s)) * share * (base - start)
        wrist = np.where(times[:, None] < release, wrist, away)
        opening = 0.05 + rng.uniform(0.05, 0.35) * np.clip((times - release + 0.05) / 0.1, 0, 1)
    bend = rng.uniform(-0.1, 0.9, (1, 5)) + 0.3 * smooth_path(rng.normal(0, 1, (3, 5)), np.linspace(0, 1, 3), times)
    grain = 1 + 0.08 * fractal_noise(rng, 128, 128)[..., None]
    skin = (sample_skin(rng) * grain).astype(np.float32)
    sleeve = sample_background(rng, 128, 128)
    angle = rng.uniform(0, 2 * math.pi)
    return Hand(
        base=base,
        wrist=wrist,
        spread=opening.reshape(count),
        palm=palm,
        lengths=lengths,
        bend=bend,
        skin=skin,
        sleeve=sleeve,
        sleeve_from=float(rng.choice([rng.uniform(0.0, 0.3), rng.uniform(0.3, 1.5)])),
        mirrored=float(rng.choice([-1.0, 1.0])),
        light=np.array([math.cos(angle), math.sin(angle)]),
    )


def draw_hand(hand: Hand, t: int, width: int, height: int) -> np.ndarray:
    """Layer float32 (H, W, 4) of the hand in frame t."""
    wrist, palm = hand.wrist[t], hand.palm
    way = wrist - hand.base
    way = way / (np.linalg.norm(way) + 1e-6)
    heading = math.atan2(way[1], way[0])
    skin, sleeve = np.zeros((height, width), np.uint8), np.zeros((height, width), np.uint8)

    def capsule(canvas: np.ndarray, a: np.ndarray, b: np.ndarray, radius: float) -> None:
        ends = [tuple(round(float(v) * 16) for v in p) for p in (a, b)]
        cv2.line(canvas, ends[0], ends[1], 255, max(int(2 * radius), 1), cv2.LINE_AA, 4)
        for end in ends:
            cv2.circle(canvas, end, max(int(radius * 16), 8), 255, -1, cv2.LINE_AA, 4)

    centre = wrist + way * palm * 0.9
    capsule(skin, hand.base, wrist, 0.62 * palm)
    capsule(skin, wrist + 0.3 * palm * way, centre, 0.85 * palm)
    for k in range(5):
        if k == 0:  # the thumb
            angle = heading + hand.mirrored * (0.9 + hand.spread[t])
            root = wrist + 0.5 * palm * np.array([math.cos(angle), math.sin(angle)])
            length = 0.8 * hand.lengths[0] * palm
        else:
            angle = heading + hand.mirrored * (2.5 - k) * (0.12 + hand.spread[t])
            root = centre + 0.6 * palm * np.array([math.cos(angle), math.sin(angle)])
            length = hand.lengths[k] * palm
        joint = root + 0.55 * length * np.array([math.cos(angle), math.sin(angle)])
        angle += hand.mirrored * hand.bend[t, k]
        tip = joint + 0.45 * length * np.array([math.cos(angle), math.sin(angle)])
        capsule(skin, root, joint, 0.2 * palm)
        capsule(skin, joint, tip, 0.17 * palm)
    cuff = wrist - way * palm * 4 * hand.sleeve_from
    capsule(sleeve, hand.base, cuff, 0.85 * palm)
    alpha = np.maximum(skin, sleeve).astype(np.float32) / 255
    rows, cols = np.arange(height)[:, None], np.arange(width)[None]
    shift = np.round(wrist).astype(int)
    pick = ((rows - shift[1]) % 128, (cols - shift[0]) % 128)
    picture = np.where((sleeve > 127)[..., None], hand.sleeve[pick], hand.skin[pick])
    solid = cv2.GaussianBlur(
        cv2.distanceTransform((alpha > 0.5).astype(np.uint8), cv2.DIST_L2, 3), (0, 0), 0.15 * palm + 0.5
    )
    dx, dy = cv2.Sobel(solid, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(solid, cv2.CV_32F, 0, 1) / 8
    lit = np.clip(0.85 - 0.35 * (dx * hand.light[0] + dy * hand.light[1]), 0.3, 1.3)
    return np.concatenate([picture * lit[..., None], alpha[..., None]], -1).astype(np.float32)


def let_go(
    rng: np.random.Generator, frames: np.ndarray, held: np.ndarray, radius: float, times: np.ndarray, release: float
) -> np.ndarray:
    """Draw a hand that holds a body and lets it go over frames, in place, and return the pixels that it covers.

    Args:
        rng: Random numbers.
        frames: (T, H, W, 3) float32, 0 to 255.
        held: (T, 2) px, the body's centre.
        radius: px, of the body.
        times: (T,) s, of the frames.
        release: s, when the hand lets go.

    Returns:
        (T, H, W) float32, how much of each pixel the hand covers.
    """
    height, width = frames.shape[1:3]
    palm = radius * rng.uniform(0.8, 1.6)
    hand = sample_hand(rng, width, height, held, palm, times / times[-1], min(release / times[-1], 1.0))
    covered = np.empty(frames.shape[:3], np.float32)
    for t in range(len(frames)):
        layer = draw_hand(hand, t, width, height)
        frames[t] += layer[..., 3:] * (255 * layer[..., :3] - frames[t])
        covered[t] = layer[..., 3]
    return covered


@dataclass(frozen=True)
class Cloth:
    """A sheet whose outline waves, hung at the border or carried through. outline: (T, K, 2) px. texture: (h, w, 3).
    shift: (T, 2) px of the texture."""

    outline: np.ndarray
    texture: np.ndarray
    shift: np.ndarray
    opacity: float


def sample_cloth(rng: np.random.Generator, width: int, height: int, times: np.ndarray) -> Cloth:
    """A waving or passing sheet: cloth, a sleeve, a torso, a curtain, smoke."""
    count = int(rng.integers(8, 24))
    turn = np.linspace(0, 2 * math.pi, count, endpoint=False)
    size = log_uniform(rng, 0.05, 0.6) * height
    reach = size * (1 + 0.35 * rng.normal(size=count))
    side = rng.uniform(0, 1)
    anchor = np.array([[0.0, side], [1.0, side], [side, 0.0], [side, 1.0]][int(rng.integers(4))]) * [width, height]
    moving = rng.random() < 0.6
    drift = rng.normal(0, 0.4 * height, (3, 2)) if moving else rng.normal(0, 0.02 * height, (3, 2))
    shift = smooth_path(drift, np.array([0.0, 0.5, 1.0]), times)
    speed, waves = log_uniform(rng, 2, 30), int(rng.integers(1, 5))
    sway = size * rng.uniform(0.02, 0.3) * np.sin(times[:, None] * speed + waves * turn[None] + rng.uniform(0, 6))
    radius = np.maximum(reach[None] + sway, 2.0)
    outline = anchor + shift[:, None] + radius[..., None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    opacity = 1.0 if rng.random() < 0.8 else rng.uniform(0.3, 0.8)
    return Cloth(outline, sample_background(rng, 256, 256), shift, float(opacity))


def draw_cloth(cloth: Cloth, t: int, width: int, height: int) -> np.ndarray:
    """Layer float32 (H, W, 4) of the sheet in frame t."""
    alpha = np.zeros((height, width), np.uint8)
    cv2.fillPoly(alpha, [np.round(cloth.outline[t] * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    shift = np.round(cloth.shift[t]).astype(int)
    rows, cols = (np.arange(height)[:, None] - shift[1]) % 256, (np.arange(width)[None] - shift[0]) % 256
    picture = cloth.texture[rows, cols]
    return np.concatenate([picture, cloth.opacity * alpha[..., None].astype(np.float32) / 255], -1)


def sample_passing_shadow(rng: np.random.Generator, width: int, height: int, times: np.ndarray) -> np.ndarray:
    """Factors float32 (T, H, W, 1): the soft shadow of something out of view that moves over the picture."""
    knots = rng.uniform(-0.2, 1.2, (3, 2)) * [width, height]
    if rng.random() < 0.5:
        knots = knots[:1] + rng.normal(0, 0.08 * height, (3, 2))
    path = smooth_path(knots, np.array([0.0, 0.5, 1.0]), times)
    size, soft = log_uniform(rng, 0.05, 0.5) * height, log_uniform(rng, 0.01, 0.2) * height
    depth, shape = rng.uniform(0.05, 0.6), rng.uniform(0.3, 1.0)
    angle = rng.uniform(0, 180)
    small = (max(width // 4, 1), max(height // 4, 1))
    out = np.empty((len(times), height, width, 1), np.float32)
    for t, (x, y) in enumerate(path):
        canvas = np.zeros((small[1], small[0]), np.float32)
        cv2.ellipse(canvas, ((x / 4, y / 4), (size / 2, size * shape / 2), angle), 1.0, -1)
        blurred = cv2.GaussianBlur(canvas, (0, 0), max(soft / 4, 0.5))
        out[t, ..., 0] = 1 - depth * cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
    return out
