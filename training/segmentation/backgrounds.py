"""Still pictures to put behind bodies: gradients, 1/f noise, dead leaves, rooms, shelves, text.

Nothing is a photograph. Dead leaves (Lee, Mumford & Huang, IJCV 2001) and 1/f spectra have a photograph's statistics
of edges and of frequencies.
"""

from __future__ import annotations

import colorsys
import math

import cv2
import numpy as np

LETTERS = "ABCDEFGHIKLMNOPRSTUVWXYZ0123456789 "


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def sample_colour(rng: np.random.Generator) -> np.ndarray:
    """RGB (3,) float32 in [0, 1]: grey, muted or vivid, dark to bright."""
    saturation = float(rng.choice([rng.uniform(0, 0.08), rng.uniform(0.05, 0.4), rng.uniform(0.3, 1.0)]))
    return np.array(colorsys.hsv_to_rgb(rng.random(), saturation, rng.uniform(0.02, 1.0) ** 0.8), np.float32)


def gradient(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): one colour, or two mixed along a direction."""
    first = sample_colour(rng)
    if rng.random() < 0.4:
        return np.broadcast_to(first, (height, width, 3)).copy()
    second = np.clip(first * rng.uniform(0.4, 1.5) + rng.normal(0, 0.05, 3), 0, 1).astype(np.float32)
    angle = rng.uniform(0, 2 * math.pi)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    along = math.cos(angle) * x / width + math.sin(angle) * y / height
    along = (along - along.min()) / (np.ptp(along) + 1e-6)
    return first + along[..., None] ** rng.uniform(0.5, 2) * (second - first)


def fractal_noise(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W) noise of zero mean and unit deviation whose amplitude falls as 1 / frequency^a, a in 0.7 to 2."""
    fy, fx = np.fft.fftfreq(height)[:, None] * height, np.fft.rfftfreq(width)[None] * width
    stretch = log_uniform(rng, 0.15, 6) if rng.random() < 0.4 else 1.0  # grain of wood, brushed metal
    radius = np.hypot(fy * stretch, fx / stretch) + 1.0
    spectrum = rng.normal(size=(height, width // 2 + 1)) + 1j * rng.normal(size=(height, width // 2 + 1))
    noise = np.fft.irfft2(spectrum / radius ** rng.uniform(0.7, 2.0), (height, width))
    return ((noise - noise.mean()) / (noise.std() + 1e-9)).astype(np.float32)


def noisy(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): a gradient under 1/f noise: plaster, wood, stone, cloth."""
    tint = rng.uniform(0.3, 1.0, 3).astype(np.float32)
    noise = fractal_noise(rng, width, height)[..., None] * tint * rng.uniform(0.01, 0.2)
    if rng.random() < 0.3:
        noise += fractal_noise(rng, width, height)[..., None] * tint[::-1] * rng.uniform(0.01, 0.12)
    return gradient(rng, width, height) * (1 + noise) + 0.3 * noise


def draw_shape(rng: np.random.Generator, picture: np.ndarray, radius: float, colour: np.ndarray) -> None:
    """Draw one random filled or outlined shape of about `radius` px somewhere on the picture (H, W, 3), in place."""
    height, width = picture.shape[:2]
    x, y = float(rng.uniform(-0.1, 1.1) * width), float(rng.uniform(-0.1, 1.1) * height)
    ink = tuple(float(c) for c in colour)
    kind = rng.random()
    a, b = radius * rng.uniform(0.3, 1.6), radius * rng.uniform(0.3, 1.6)
    angle = float(rng.choice([0.0, rng.uniform(0, 180)]))
    filled = -1 if rng.random() < 0.8 else int(rng.integers(1, 5))
    if kind < 0.4:
        corners = cv2.boxPoints(((x, y), (2 * a, 2 * b), angle)).astype(np.int32)
        if filled < 0:
            cv2.fillPoly(picture, [corners], ink, cv2.LINE_AA)
        else:
            cv2.polylines(picture, [corners], True, ink, filled, cv2.LINE_AA)
    elif kind < 0.7:
        axes = (int(a) + 1, int(b if rng.random() < 0.5 else a) + 1)
        cv2.ellipse(picture, (int(x), int(y)), axes, angle, 0, 360, ink, filled, cv2.LINE_AA)
    elif kind < 0.85:
        count = int(rng.integers(3, 8))
        turn = np.sort(rng.uniform(0, 2 * math.pi, count))
        reach = radius * rng.uniform(0.4, 1.3, count)
        points = np.stack([x + reach * np.cos(turn), y + reach * np.sin(turn)], 1).astype(np.int32)
        cv2.fillPoly(picture, [points], ink, cv2.LINE_AA)
    else:
        way = rng.uniform(0, math.pi) if rng.random() < 0.5 else float(rng.choice([0, math.pi / 2]))
        dx, dy = 2 * radius * math.cos(way), 2 * radius * math.sin(way)
        thick = int(rng.integers(1, 9))
        cv2.line(picture, (int(x - dx), int(y - dy)), (int(x + dx), int(y + dy)), ink, thick, cv2.LINE_AA)


def dead_leaves(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): shapes of all sizes (density of radii as 1 / r³) over one another, each with its own shade."""
    picture = noisy(rng, width, height)
    base, spread = sample_colour(rng), rng.uniform(0.05, 0.4)
    for _ in range(int(rng.integers(30, 250))):
        radius = 4.0 / math.sqrt(rng.uniform(0.002, 1.0))
        colour = sample_colour(rng) if rng.random() < 0.3 else np.clip(base + rng.normal(0, spread, 3), 0, 1)
        draw_shape(rng, picture, radius, colour)
    return picture * (1 + fractal_noise(rng, width, height)[..., None] * np.float32(rng.uniform(0, 0.1)))


def clutter(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): a plain or noisy picture with some things on it."""
    picture = noisy(rng, width, height) if rng.random() < 0.6 else gradient(rng, width, height)
    for _ in range(int(rng.integers(2, 25))):
        draw_shape(rng, picture, log_uniform(rng, 3, 120), sample_colour(rng))
    return picture


def room(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): a wall over a floor, often with tiles, boards, a skirting board or a side wall."""
    picture = noisy(rng, width, height)
    floor = tiles(rng, width, height) if rng.random() < 0.4 else noisy(rng, width, height)
    left = height * rng.uniform(0.3, 0.97)
    right = left + height * rng.normal(0, 0.08)
    edge = left + (right - left) * np.arange(width) / width
    below = np.clip(np.arange(height)[:, None] - edge[None] + 0.5, 0, 1)[..., None].astype(np.float32)
    picture += below * (floor - picture)
    if rng.random() < 0.4:
        board = height * rng.uniform(0.01, 0.06)
        corners = np.array([[0, left - board], [width, right - board], [width, right], [0, left]], np.int32)
        cv2.fillPoly(picture, [corners], tuple(float(c) for c in sample_colour(rng)), cv2.LINE_AA)
    for _ in range(int(rng.integers(0, 7))):
        draw_shape(rng, picture, log_uniform(rng, 5, 90), sample_colour(rng))
    return picture


def tiles(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): a grid of tiles, a checkerboard or boards, seen at an angle."""
    side = log_uniform(rng, 8, 90)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    turn, squeeze = rng.uniform(0, math.pi), rng.uniform(0.3, 1.0)
    u = (math.cos(turn) * x + math.sin(turn) * y / squeeze) / side
    v = (-math.sin(turn) * x + math.cos(turn) * y / squeeze) / (side * log_uniform(rng, 0.5, 4))
    first, second = sample_colour(rng), sample_colour(rng)
    if rng.random() < 0.5:
        second = np.clip(first * rng.uniform(0.7, 1.3), 0, 1)
    mix = ((np.floor(u) + np.floor(v)) % 2)[..., None] if rng.random() < 0.5 else np.float32(0)
    joint = (np.minimum(u % 1, v % 1) < rng.uniform(0.01, 0.06))[..., None] * np.float32(rng.random() < 0.7)
    picture = first + mix * (second - first)
    picture = picture * (1 - joint * rng.uniform(0.2, 0.8))
    return (picture * (1 + 0.06 * fractal_noise(rng, width, height)[..., None])).astype(np.float32)


def shelves(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """(H, W, 3): rows of upright coloured things, as books on shelves."""
    picture = noisy(rng, width, height)
    y = float(rng.uniform(0, 0.2) * height)
    while y < height:
        row, x = height * rng.uniform(0.12, 0.4), float(rng.uniform(-10, 30))
        while x < width:
            w = log_uniform(rng, 4, 50)
            if rng.random() < 0.85:
                top = y + row * rng.uniform(0, 0.4)
                ink = tuple(float(c) for c in sample_colour(rng))
                cv2.rectangle(picture, (int(x), int(top)), (int(x + w), int(y + row)), ink, -1)
            x += w + rng.uniform(0, 3)
        y += row + height * rng.uniform(0.01, 0.05)
    return picture


def put_text(rng: np.random.Generator, picture: np.ndarray) -> None:
    """Write one to six words on the picture (H, W, 3), in place."""
    height, width = picture.shape[:2]
    for _ in range(int(rng.integers(1, 7))):
        word = "".join(LETTERS[i] for i in rng.integers(0, len(LETTERS), int(rng.integers(1, 14))))
        place = (int(rng.uniform(-0.1, 0.9) * width), int(rng.uniform(0, 1.1) * height))
        ink = np.zeros((height, width), np.uint8)
        cv2.putText(ink, word, place, 0, log_uniform(rng, 0.3, 3), 255, int(rng.integers(1, 5)), cv2.LINE_AA)
        picture += (ink / np.float32(255))[..., None] * (sample_colour(rng) - picture)


def put_ruler(rng: np.random.Generator, picture: np.ndarray) -> None:
    """Draw a banded stick along a random line of the picture (H, W, 3), in place."""
    height, width = picture.shape[:2]
    start = rng.uniform(0, 1, 2) * [width, height]
    way = np.array([[1.0, 0.0], [0.0, 1.0]][int(rng.integers(2))]) + rng.normal(0, 0.05, 2)
    band, thick = log_uniform(rng, 8, 50), log_uniform(rng, 3, 20)
    inks = [tuple(float(c) for c in sample_colour(rng)) for _ in range(2)]
    across = np.array([-way[1], way[0]]) * thick
    for k in range(int(rng.integers(6, 30))):
        a, b = start + k * band * way, start + (k + 1) * band * way
        cv2.fillPoly(picture, [np.array([a, b, b + across, a + across]).astype(np.int32)], inks[k % 2], cv2.LINE_AA)


PICTURES = {gradient: 0.17, noisy: 0.2, dead_leaves: 0.12, clutter: 0.2, room: 0.2, tiles: 0.06, shelves: 0.05}


def sample_background(rng: np.random.Generator, width: int, height: int) -> np.ndarray:
    """A still picture float32 (H, W, 3) in [0, 1]."""
    weights = np.array(list(PICTURES.values()))
    kind = list(PICTURES)[int(rng.choice(len(weights), p=weights / weights.sum()))]
    picture = np.ascontiguousarray(kind(rng, width, height), np.float32)
    if rng.random() < 0.15:
        put_text(rng, picture)
    if rng.random() < 0.15:
        put_ruler(rng, picture)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    for _ in range(int(rng.choice([0, 1, 2], p=[0.65, 0.25, 0.1]))):  # lamps, their reflections, dark corners
        cx, cy, s = rng.uniform(0, width), rng.uniform(0, height), log_uniform(rng, 0.03, 0.5) * width
        spot = np.exp(-(((x - cx) / s) ** 2 + ((y - cy) / (s * rng.uniform(0.4, 1.5))) ** 2))[..., None]
        picture += spot * rng.choice([rng.uniform(0.1, 1.5), rng.uniform(-0.5, -0.1)])
    if rng.random() < 0.4:
        exposure = rng.choice([rng.uniform(0.08, 0.5), rng.uniform(1.0, 1.6)], p=[0.6, 0.4])
        picture *= exposure
    return np.clip(cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.4, 2.0))), 0.0, 1.0).astype(np.float32)
