"""Flat bodies: pictures with opacity of balls, pucks, carts, blocks, pipes and odd plates, seen straight on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from training.segmentation.backgrounds import dead_leaves, log_uniform, noisy, put_text, sample_colour


@dataclass(frozen=True)
class Sprite:
    """picture: (S, S, 3) float32 in [0, 1], alpha: (S, S); the body's radius (half height of a long one) is `unit` px
    of it. shading: (S, S) factors that do not turn with the body. round: it rolls. turns_visibly: its picture shows
    a turn. reach: largest extent from the centre, in radii."""

    picture: np.ndarray
    alpha: np.ndarray
    shading: np.ndarray
    unit: float
    round: bool
    turns_visibly: bool
    reach: float


def surface(rng: np.random.Generator, size: int) -> tuple[np.ndarray, bool]:
    """A texture (S, S, 3), and whether a turn of it can be seen."""
    base = sample_colour(rng)
    picture = np.broadcast_to(base, (size, size, 3)).copy()
    kind = rng.random()
    if kind < 0.45:
        return picture, False
    if kind < 0.6:
        return np.clip(noisy(rng, size, size), 0, 1), True
    if kind < 0.68:
        return np.clip(dead_leaves(rng, size, size), 0, 1), True
    second = sample_colour(rng)
    y, x = (np.mgrid[:size, :size].astype(np.float32) + 0.5) / size - 0.5
    if kind < 0.78:  # marks: a bar, spokes, sectors
        angle, count = np.arctan2(y, x) + rng.uniform(0, 6), int(rng.integers(1, 5))
        wide = rng.uniform(0.03, 0.12)
        if rng.random() < 0.5:
            inside = np.abs(np.hypot(x, y) * np.sin(angle * count / 2)) < wide
        else:
            inside = np.cos(count * angle) > rng.uniform(-0.5, 0.8)
        picture[inside] = second
        return picture, True
    if kind < 0.86:  # dots
        for _ in range(int(rng.integers(1, 6))):
            place = rng.uniform(-0.35, 0.35, 2)
            picture[np.hypot(x - place[0], y - place[1]) < log_uniform(rng, 0.03, 0.2)] = second
        return picture, True
    if kind < 0.94:  # a ring
        radius, inner = np.hypot(x, y), rng.uniform(0.1, 0.3)
        picture[(radius > inner) & (radius < inner + rng.uniform(0.03, 0.15))] = second
        return picture, False
    ink = np.ascontiguousarray(picture)
    put_text(rng, ink)
    return ink, True


def sample_sprite(rng: np.random.Generator, unit: float, behind: np.ndarray) -> Sprite:
    """A body whose radius is `unit` px of its picture. behind: (3,) colour of what is behind it, which it sometimes
    nearly has."""
    half = math.ceil(max(2.6 * unit, 4)) + 2
    size = 2 * half
    picture, visible = surface(rng, size)
    if rng.random() < 0.18:
        picture = np.clip(picture * 0.3 + 0.7 * behind * rng.uniform(0.75, 1.25), 0, 1)
    y, x = (np.mgrid[:size, :size].astype(np.float32) + 0.5 - half) / unit
    soft = 1.0 / unit
    radius = np.hypot(x, y)
    kind = rng.choice(
        ["ball", "disc", "ring", "box", "cart", "polygon", "blob"], p=[0.28, 0.2, 0.06, 0.18, 0.14, 0.08, 0.06]
    )
    shading, reach = np.ones((size, size), np.float32), 1.0
    if kind in ("ball", "disc", "ring"):
        away = radius - 1
        if kind == "ring":
            away = np.maximum(away, rng.uniform(0.3, 0.85) - radius)
    elif kind in ("box", "cart"):
        aspect = log_uniform(rng, 0.6, 2.4)
        away = np.maximum(np.abs(x) - aspect, np.abs(y) - 1)
        reach = math.hypot(aspect, 1)
        picture = picture.copy()
        if kind == "cart":  # wheels and a load
            chassis = np.maximum(np.abs(x) - aspect, np.abs(y + 0.2) - rng.uniform(0.3, 0.75))
            wheels = np.minimum(np.hypot(x - 0.6 * aspect, y - 0.6), np.hypot(x + 0.6 * aspect, y - 0.6)) - 0.4
            load = np.maximum(np.abs(x - rng.uniform(-0.5, 0.5)) - 0.3 * aspect, np.abs(y + 0.6) - 0.4)
            picture[wheels < 0] = sample_colour(rng)
            picture[load < 0] = sample_colour(rng)
            away = np.minimum(np.minimum(chassis, wheels), load)
        if rng.random() < 0.35:  # clear or pale between its ends, or inside a frame
            inner = np.abs(x) - aspect * rng.uniform(0.5, 0.9)
            if rng.random() < 0.4:
                inner = np.maximum(inner, np.abs(y) - rng.uniform(0.5, 0.85))
            clear = np.clip(behind * rng.uniform(0.85, 1.15) + rng.normal(0, 0.03, 3), 0, 1)
            picture[inner < 0] = rng.uniform(0.6, 1.0) * clear + 0.2 * picture[inner < 0]
            if rng.random() < 0.5:  # with rails along it
                picture[(inner < 0) & (np.abs(np.abs(y) - rng.uniform(0.2, 0.8)) < 0.08)] = sample_colour(rng)
        visible = True
    else:
        angle = np.arctan2(y, x)
        if kind == "polygon":
            count = int(rng.integers(3, 9))
            sector = 2 * math.pi / count
            away = radius * np.cos((angle % sector) - sector / 2) - math.cos(sector / 2)
        else:
            wave = sum(rng.normal(0, 0.25) * np.cos(k * angle + rng.uniform(0, 6)) for k in (1, 2, 3))
            away = radius - np.clip(1 + wave, 0.4, 2)
            reach = 2.0
        visible = True
    alpha = np.clip(0.5 - away / soft, 0, 1).astype(np.float32)
    way = rng.uniform(0, 2 * math.pi)
    light = np.array([math.cos(way), math.sin(way), rng.uniform(0.4, 1.5)])
    light /= np.linalg.norm(light)
    if kind == "ball":
        z = np.sqrt(np.clip(1 - radius**2, 0, 1))
        ambient = rng.uniform(0.2, 0.7)
        lambert = np.clip(x * light[0] + y * light[1] + z * light[2], 0, 1)
        shading = (ambient + (1.1 - ambient) * lambert).astype(np.float32)
        if rng.random() < 0.5:
            shading += (rng.uniform(0.3, 1.5) * lambert ** rng.uniform(15, 80)).astype(np.float32)
    elif rng.random() < 0.5:  # a rim
        shading = np.where(away > -rng.uniform(0.05, 0.3), np.float32(rng.uniform(0.3, 1.4)), np.float32(1.0))
    elif rng.random() < 0.5:
        shading = (1 + 0.25 * (x * light[0] + y * light[1])).astype(np.float32)
    return Sprite(
        picture=picture.astype(np.float32),
        alpha=alpha,
        shading=shading,
        unit=unit,
        round=kind in ("ball", "disc", "ring"),
        turns_visibly=visible,
        reach=reach,
    )


def placed(
    sprite: Sprite, centre: np.ndarray, radius: float, angle: float, width: int, height: int, shear: tuple[float, float]
) -> tuple[np.ndarray, tuple[slice, slice]] | None:
    """The sprite as a layer (h, w, 4) and the window of the picture that it fills; None where it is out of view.

    centre: (2,) px, radius: px, angle: rad, clockwise as seen. shear: px by which it moves while the sensor reads as
    many rows as it is high (rolling shutter).
    """
    extent = radius * (sprite.reach + 0.3) + 3 + abs(shear[0]) + abs(shear[1])
    left, right = max(int(centre[0] - extent), 0), min(int(centre[0] + extent) + 2, width)
    top, bottom = max(int(centre[1] - extent), 0), min(int(centre[1] + extent) + 2, height)
    if left >= right or top >= bottom:
        return None
    scale, half = radius / sprite.unit, sprite.picture.shape[0] / 2
    turn = scale * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    roll = np.array([[1.0, shear[0] / (2 * radius)], [0.0, 1.0 + shear[1] / (2 * radius)]])

    def warp(picture: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        shift = centre - 0.5 - [left, top] - matrix @ [half - 0.5, half - 0.5]
        affine = np.concatenate([matrix, shift[:, None]], 1)
        return cv2.warpAffine(picture, affine, (right - left, bottom - top), flags=cv2.INTER_LINEAR)

    colour = warp(sprite.picture, roll @ turn)
    alpha = warp(sprite.alpha, roll @ turn)
    # Beyond its picture a shading of 0 is warped in, where alpha is 0 too.
    colour = colour * warp(sprite.shading, roll * scale)[..., None]
    return np.concatenate([np.clip(colour, 0, 1), alpha[..., None]], -1), (slice(top, bottom), slice(left, right))
