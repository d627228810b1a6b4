"""Bodies that hang: swings are found from tracks by evidence, in any scale and also about points out of the picture."""

import numpy as np
import pytest

from pipeline.bodies.tracks.continued_body import continued_bodies
from pipeline.bodies.tracks.image_track import ImageTrack, image_tracks
from pipeline.worlds.arcs import cut_arcs
from pipeline.worlds.swing import fit_swing
from pipeline.worlds.view import find_view

TIMES = np.arange(40) / 20


def track_of(centre: np.ndarray, times: np.ndarray, radius: float = 8.0, sigma: float = 0.2) -> ImageTrack:
    count = len(times)
    return ImageTrack(
        body=1,
        frames=np.arange(count),
        times=times,
        centre=centre,
        axes=np.full((count, 2), radius),
        angle=np.zeros(count),
        area=np.full(count, np.pi * radius**2),
        whole=np.ones(count, bool),
        sigma=sigma,
    )


def swinging(
    rng: np.random.Generator, length_m: float, px_per_m: float, wide: float, damping: float, pivot: tuple[float, float]
) -> np.ndarray:
    """(T, 2) px of a pendulum that starts at rest at an angle, with errors of 0.2 px; by explicit small steps."""
    angle, speed, out, h = wide, 0.0, [], 1e-4
    for _ in TIMES:
        out.append((np.sin(angle), np.cos(angle)))
        for _ in range(round(0.05 / h)):
            speed -= h * (9.81 / length_m * np.sin(angle) + 2 * damping * speed)
            angle += h * speed
    return np.array(pivot) + px_per_m * length_m * np.array(out) + rng.normal(0, 0.2, (len(TIMES), 2))


def test_a_swing_tells_its_length_by_its_period_and_its_damping(rng: np.random.Generator) -> None:
    length, px_per_m, damping = rng.uniform(0.2, 0.8), rng.uniform(200, 600), rng.uniform(0.0, 0.3)
    pivot = (rng.uniform(100, 500), rng.uniform(-300, 50))  # also above the picture
    wide = rng.uniform(0.3, 1.4)
    track = track_of(swinging(rng, length, px_per_m, wide, damping, pivot), TIMES)
    swing = fit_swing(track, 0.0, 3.0)
    assert swing is not None
    assert 9.81 / swing.rate == pytest.approx(length, rel=0.02)
    assert swing.length / px_per_m == pytest.approx(length, rel=0.03)
    assert swing.damping == pytest.approx(damping, abs=0.03)
    view = find_view([track], [cut_arcs(track)])
    assert view.kind == "hanging"
    assert view.gravity_px is not None
    assert view.gravity_px[1] / px_per_m == pytest.approx(9.81, rel=0.04)


@pytest.mark.parametrize("law", ["thrown", "straight", "bounces", "slope"])
def test_what_flies_rolls_or_bounces_does_not_hang(law: str, rng: np.random.Generator) -> None:
    t = TIMES / 2
    x, fall = rng.uniform(100, 400) * t, rng.uniform(500, 1500)
    y = {
        "thrown": -rng.uniform(200, 600) * t + fall * t**2 / 2,
        "straight": 0.2 * x,
        "bounces": 200 - np.abs(fall * (t % 0.4) * (0.4 - t % 0.4) / 2),
        "slope": 0.3 * x,
    }[law]
    if law == "slope":
        x, y = x * t, y * t
    track = track_of(np.stack([x, y], 1) + rng.normal(0, 0.2, (len(t), 2)), t)
    assert find_view([track], [cut_arcs(track)]).kind != "hanging"


def discs(rows: list[dict[int, tuple[float, float]]], radius: float = 6.0) -> np.ndarray:
    """Masks (T, 80, 160) of discs by number and centre."""
    y, x = np.mgrid[:80, :160]
    masks = np.zeros((len(rows), 80, 160), np.uint8)
    for mask, row in zip(masks, rows, strict=True):
        for number, (cx, cy) in row.items():
            mask[(x - cx) ** 2 + (y - cy) ** 2 < radius**2] = number
    return masks


def coloured(masks: np.ndarray, colours: dict[int, tuple[int, int, int]]) -> np.ndarray:
    frames = np.full((*masks.shape, 3), 90, np.uint8)
    for number, colour in colours.items():
        frames[masks == number] = colour
    return frames


def test_a_body_that_leaps_between_two_frames_keeps_its_number_and_others_do_not() -> None:
    rows: list[dict[int, tuple[float, float]]] = [{1: (20 + 8 * t, 30)} for t in range(5)]
    rows += [{2: (110 + 8 * t, 40)} for t in range(5)]
    masks, times = discs(rows), np.arange(10) / 10
    same = coloured(masks, {1: (200, 30, 30), 2: (200, 30, 30)})
    joined, groups = continued_bodies(masks, same, times, [False, False])
    assert groups == [[0, 1]]
    assert len(image_tracks(joined, times)) == 1
    other = coloured(masks, {1: (200, 30, 30), 2: (30, 30, 200)})
    assert continued_bodies(masks, other, times, [False, False])[1] == [[0], [1]]  # another colour
    assert continued_bodies(masks, same, times, [True, True])[1] == [[0], [1]]  # the user pointed at both
    later = np.concatenate([masks[:5], np.zeros_like(masks[:1]), masks[5:]])
    seen = np.concatenate([same[:5], same[:1], same[5:]])
    assert continued_bodies(later, seen, np.arange(11) / 10, [False, False])[1] == [[0], [1]]  # a frame without any
