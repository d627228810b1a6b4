"""Breaks of a recording: dropped frames, a bumped camera, swapped names, and what is none of them."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.discovery.tracks.breaks import mend_breaks
from pipeline.discovery.tracks.track import Track

NOISE, RATE = 0.002, 60.0


def flight(rng: np.random.Generator, clip: str = "a", name: str = "ball", start: tuple = (0.0, 0.0, 2.0)) -> Track:
    """A second of free flight."""
    time = np.arange(61) / RATE
    velocity = rng.normal(0, 1.5, 3) + np.array([1.0, 0.0, 1.0])
    position = start + velocity * time[:, None] + 0.5 * np.array([0, 0, -9.81]) * time[:, None] ** 2
    return Track(clip, name, time, position + rng.normal(0, NOISE, position.shape))


def bounces(rng: np.random.Generator, clip: str) -> Track:
    """A puck that slides, hits walls and stops."""
    time = np.arange(61) / RATE
    place, velocity, out = np.zeros(3), np.array([rng.uniform(0.8, 2.5), rng.uniform(-1, 1), 0.0]), []
    fine = 20
    for _ in time:
        out.append(place)
        for _ in range(fine):
            speed = float(np.linalg.norm(velocity))
            velocity = velocity * max(0.0, 1 - 1.5 / (RATE * fine) / max(speed, 1e-9))
            place = place + velocity / (RATE * fine)
            if abs(place[0]) > 0.4 and place[0] * velocity[0] > 0:
                velocity = velocity * [-0.7, 1, 1]
    return Track(clip, "puck", time, np.array(out) + rng.normal(0, NOISE, (len(time), 3)))


def test_dropped_frames_are_found_where_they_are_and_mended(rng: np.random.Generator) -> None:
    whole = flight(rng)
    kept = np.delete(np.arange(61), [20, 21, 45])
    counted = np.arange(len(kept)) / RATE  # times are counted in frames
    mended, faults = mend_breaks([replace(whole, time=counted, position=whole.position[kept])])
    assert [(f.fault, f.size) for f in faults] == [("dropped_frames", 2), ("dropped_frames", 1)]
    assert [f.time for f in faults] == pytest.approx([19.5 / RATE, 42.5 / RATE], abs=1.1 / RATE)
    assert np.abs(mended[0].time - whole.time[kept]).max() < 1e-9


def test_a_bumped_camera_shifts_all_bodies_alike(rng: np.random.Generator) -> None:
    tracks = [flight(rng), flight(rng, name="other", start=(1.0, 0.5, 2.0))]
    shift = np.array([0.02, -0.03, 0.01])
    bumped = [replace(t, position=t.position + (t.time > 0.5)[:, None] * shift) for t in tracks]
    mended, (fault,) = mend_breaks(bumped)
    assert fault.fault == "bumped_camera" and fault.clip == "a"
    assert fault.size == pytest.approx(np.linalg.norm(shift), rel=0.15)
    assert max(np.abs(m.position - t.position).max() for m, t in zip(mended, tracks, strict=True)) < 0.006


def test_swapped_names_are_given_back(rng: np.random.Generator) -> None:
    one, other = flight(rng), flight(rng, name="other", start=(0.6, 0.3, 2.1))
    late = one.time > 0.4
    crossed = [
        replace(a, position=np.where(late[:, None], b.position, a.position)) for a, b in ((one, other), (other, one))
    ]
    mended, (fault,) = mend_breaks(crossed)
    assert fault.fault == "swapped_names" and fault.object == "ball, other"
    assert all((m.position == t.position).all() for m, t in zip(mended, (one, other), strict=True))


def test_impacts_stops_and_flights_are_no_breaks(rng: np.random.Generator) -> None:
    tracks = [bounces(rng, f"slide {i}") for i in range(20)] + [flight(rng, f"flight {i}") for i in range(20)]
    mended, faults = mend_breaks(tracks)
    assert faults == [] and all(a is b for a, b in zip(mended, tracks, strict=True))


def test_a_motion_that_no_cubic_follows_has_no_breaks(rng: np.random.Generator) -> None:
    time = np.arange(0, 12, 0.12)
    swing = np.column_stack([np.sin(5 * time), 0 * time, np.cos(3 * time)]) * 0.3
    assert mend_breaks([Track("a", "bob", time, swing + rng.normal(0, NOISE, swing.shape))])[1] == []
