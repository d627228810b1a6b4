"""Small measured worlds for tests: a thrown ball, by the analytic parabola or by MuJoCo with an effect."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.discovery.tracks.track import Track
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Effect, Scene, SceneObject

KNOWN: dict[str, Any] = {"objects": [{"name": "ball", "shape": "sphere", "radius": 0.05, "mass": 0.2}]}
NOISE = 0.002


def thrown(
    rng: np.random.Generator, clips: int = 8, effects: tuple[Effect, ...] = (), spin: bool = True
) -> list[Track]:
    """Throws of 1 s at 60 Hz, high enough not to land."""
    out = []
    for c in range(clips):
        velocity = (*rng.normal(0, 2.5, 2), rng.uniform(0, 2))
        ball = SceneObject(
            "sphere",
            (0.05,),
            0.2,
            position=(*rng.normal(0, 0.3, 2), 6.5),
            velocity=velocity,
            angular_velocity=tuple(rng.normal(0, 20, 3)),
            name="ball",
        )
        trace = simulate(Scene((ball,), effects=effects))
        steps = np.arange(0, 241, 4)
        position = trace.position[steps, 0] + rng.normal(0, NOISE, (len(steps), 3))
        measured = trace.angular_velocity[steps, 0] if spin else None
        out.append(Track(f"clip_{c}", "ball", trace.times[steps], position, angular_velocity=measured))
    return out


def effect(name: str, **values: Any) -> Effect:
    return Effect(name, tuple(values.items()))
