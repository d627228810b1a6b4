"""The measured sets that ship: simulated motion with an effect that its scene does not have, with noise.

Writes into data/measured a table in the format of docs/formats.md (thrown_ball.csv) and three as other programs write
them (tosses_tracker.txt, drops_vernier.csv, slides_semicolon.csv), each with a scene of what is known.
Run: python -m benchmarks.sample_measurement [--out data/measured]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.discovery.tracks.track import Track, tracks_table
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import SIZE_KEYS, Effect, Scene, SceneObject

CLIPS, FPS, SECONDS, NOISE = 6, 60, 1.0, 0.002  # noise: standard deviation of each coordinate, m
RADIUS, MASS = 0.11, 0.27  # of a volleyball, m and kg
HIDDEN = Effect("air_drag", (("coefficient", 0.011),))
SCENE = f"""\
# What is known of the recording: a ball of known size and mass, over a ground at z = 0. What is missing?
objects:
- {{name: ball, shape: sphere, radius: {RADIUS}, mass: {MASS}}}
"""
TOSSED = SceneObject("sphere", (0.035,), 0.0045, name="ball")  # of foam
TOSSED_LACKS = Effect("linear_drag", (("coefficient", 0.0027),))
PX_PER_M, ORIGIN_PX = 412.5, (160.0, 655.0)
FILTER = SceneObject("cylinder", (0.05, 0.04), 0.0012, name="filter")  # a paper cup for coffee, upside down
FILTER_LACKS = Effect("air_drag", (("coefficient", 0.004),))
PUCK = SceneObject("cylinder", (0.03, 0.015), 0.05, 0.12, name="puck")
PUCK_LACKS = Effect("tilted_gravity", (("tilt", (0.02, -0.03)),))


def recorded(
    obj: SceneObject, effect: Effect, fps: float, seconds: float, noise: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) s and positions (T, 3) m of an object from its state, with an effect and noise."""
    times = np.arange(round(fps * seconds) + 1) / fps
    trace = simulate(Scene((obj,), effects=(effect,)), seconds)
    position = trace.position[np.rint(times * trace.rate).astype(int), 0]
    return times, position + rng.normal(0, noise, position.shape)


def thrown_ball(rng: np.random.Generator) -> list[Track]:
    """Throws of one second that do not reach the ground."""
    tracks = []
    for clip in range(CLIPS):
        angle, speed = rng.uniform(-np.pi, np.pi), rng.uniform(6, 12)
        ball = SceneObject(
            shape="sphere",
            size=(RADIUS,),
            mass=MASS,
            position=(*rng.normal(0, 0.3, 2), 5.5),
            velocity=(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(0, 4)),
            name="ball",
        )
        times, position = recorded(ball, HIDDEN, FPS, SECONDS, NOISE, rng)
        tracks.append(Track(f"throw_{clip + 1}", "ball", times, position))
    return tracks


def tosses_tracker(rng: np.random.Generator) -> str:
    """Tosses across a picture, as the video analysis program Tracker exports them: pixels, y down, decimal commas."""
    lines = []
    for speed, up in ((1.5, 3.5), (2.5, 3.0), (3.5, 2.0), (4.0, 3.2), (1.0, 2.5), (3.0, 1.0)):
        ball = replace(TOSSED, position=(0.0, 0.0, 1.4), velocity=(speed, 0.0, up))
        times, position = recorded(ball, TOSSED_LACKS, 60, 0.6, 0.001, rng)
        right, down = ORIGIN_PX[0] + PX_PER_M * position[:, 0], ORIGIN_PX[1] - PX_PER_M * position[:, 2]
        lines += ["mass A\t\t", "t\tx\ty"]
        lines += [_row((t, x, y), "\t", "{:.4f}") for t, x, y in zip(times, right, down, strict=True)]
    return "\n".join(lines) + "\n"


def drops_vernier(rng: np.random.Generator) -> str:
    """Drops above a motion detector, as Vernier's programs write them: one pair of columns for each run."""
    columns, names = [], []
    for run, (height, up) in enumerate(((2.2, 0.0), (1.8, 0.0), (2.0, 1.5), (2.1, -1.0), (1.6, 2.0), (1.9, -2.0)), 1):
        body = replace(FILTER, position=(0.0, 0.0, height), velocity=(0.0, 0.0, up))
        times, position = recorded(body, FILTER_LACKS, 50, 0.6, 0.001, rng)
        columns += [times, position[:, 2]]
        names += [f'"Run {run}: Time (s)"', f'"Run {run}: Position (m)"']
    rows = [",".join(f"{value:.4f}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join([",".join(names), *rows]) + "\n"


def slides_semicolon(rng: np.random.Generator) -> str:
    """Slides of a puck seen from above, as a spreadsheet in German writes them: centimetres, a column for the trial."""
    lines = ["Versuch;Zeit (s);x (cm);y (cm)"]
    for trial, angle in enumerate(np.arange(6) * np.pi / 3, 1):
        puck = replace(PUCK, position=(0.0, 0.0, 0.0075), velocity=(1.2 * np.cos(angle), 1.2 * np.sin(angle), 0.0))
        times, position = recorded(puck, PUCK_LACKS, 60, 0.8, 0.0005, rng)
        lines += [
            _row((trial, t, 100 * x, 100 * y), ";", "{:.3f}") for t, (x, y, _) in zip(times, position, strict=True)
        ]
    return "\n".join(lines) + "\n"


def _row(values: Sequence[float], separator: str, form: str) -> str:
    """Numbers with decimal commas."""
    return separator.join(str(v) if isinstance(v, int) else form.format(v) for v in values).replace(".", ",")


def known(obj: SceneObject) -> str:
    """The scene file of an object: what is known of it."""
    sizes = ", ".join(f"{key}: {value:g}" for key, value in zip(SIZE_KEYS[obj.shape], obj.size, strict=True))
    return f"objects:\n- {{name: {obj.name}, shape: {obj.shape}, {sizes}, mass: {obj.mass:g}}}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/measured"))
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    table = tracks_table(thrown_ball(np.random.default_rng(2026))).to_pandas()
    table.to_csv(folder / "thrown_ball.csv", index=False, float_format="%.4f")
    (folder / "thrown_ball.yaml").write_text(SCENE, encoding="utf-8")
    for name, make, obj in (
        ("tosses_tracker.txt", tosses_tracker, TOSSED),
        ("drops_vernier.csv", drops_vernier, FILTER),
        ("slides_semicolon.csv", slides_semicolon, PUCK),
    ):
        (folder / name).write_text(make(np.random.default_rng(2026)), encoding="utf-8")
        (folder / name).with_suffix(".yaml").write_text(known(obj), encoding="utf-8")
    print(f"wrote four tables and their scenes into {folder}")


if __name__ == "__main__":
    main()
