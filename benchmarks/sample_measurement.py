"""The measured set that ships: flights of a thrown ball with drag, which its scene does not have.

Writes data/measured/thrown_ball.csv (measured motion) and thrown_ball.yaml (what is known of the scene).
Run: python -m benchmarks.sample_measurement [--out data/measured]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from pipeline.discrepancy.tracks.track import Track, tracks_table
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject

CLIPS, FPS, SECONDS, NOISE = 6, 60, 1.0, 0.002  # noise: standard deviation of each coordinate, m
RADIUS, MASS = 0.11, 0.27  # of a volleyball, m and kg
HIDDEN = Effect("air_drag", (("coefficient", 0.011),))
SCENE = f"""\
# What is known of the recording: a ball of known size and mass, over a ground at z = 0. What is missing?
objects:
- {{name: ball, shape: sphere, radius: {RADIUS}, mass: {MASS}}}
"""


def thrown_ball(rng: np.random.Generator) -> list[Track]:
    """Throws of one second that do not reach the ground."""
    tracks = []
    times = np.arange(round(FPS * SECONDS) + 1) / FPS
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
        trace = simulate(Scene((ball,), effects=(HIDDEN,)), SECONDS)
        position = trace.position[np.rint(times * trace.rate).astype(int), 0]
        tracks.append(Track(f"throw_{clip + 1}", "ball", times, position + rng.normal(0, NOISE, position.shape)))
    return tracks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("data/measured"))
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    assert HIDDEN.name in effect_kinds()
    table = tracks_table(thrown_ball(np.random.default_rng(2026))).to_pandas()
    table.to_csv(folder / "thrown_ball.csv", index=False, float_format="%.4f")
    (folder / "thrown_ball.yaml").write_text(SCENE, encoding="utf-8")
    print(f"wrote {folder}/thrown_ball.csv and .yaml")


if __name__ == "__main__":
    main()
