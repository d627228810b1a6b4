"""How a scene is filmed: shape of the picture, frame rate, blur, distance, a hand that lets go."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.physics.simulate import simulate
from pipeline.scene.sample_views import ASPECT
from pipeline.scene.scene import Scene

HELD = 0.4  # s before a hand lets go
SHARP = 1 / 250  # s, of an exposure: a shorter one blurs nothing


@dataclass(frozen=True)
class Way:
    """How a film is made.

    Attributes:
        name: In tables.
        fps: Frames a second; a varying rate has this mean.
        size: px, width and height.
        seconds: Of free motion.
        exposure: s, over which a frame is blurred.
        far: Factor of what the camera sees: bodies are so much smaller.
        hand: A hand holds the first body for HELD s and lets go.
        varying: Share by which the time between two frames varies.
    """

    name: str
    fps: float
    size: tuple[int, int] = (640, 360)
    seconds: float = 1.0
    exposure: float = SHARP
    far: float = 1.0
    hand: bool = False
    varying: float = 0.0

    @property
    def held(self) -> float:
        """s, before the first body is free."""
        return HELD if self.hand else 0.0

    def opened(self, count: int) -> np.ndarray:
        """(count,) s after a frame's time, at which it is exposed; (1,) of a frame that is sharp."""
        return np.linspace(0, self.exposure, count) if self.exposure > SHARP else np.zeros(1)


def seen_by(scene: Scene, way: Way) -> Scene:
    """The scene with a camera that sees, in a picture of another shape, all that the drawn one saw, times `way.far`."""
    assert scene.camera is not None
    wider = max(1.0, ASPECT * way.size[1] / way.size[0]) * way.far
    fov = 2 * np.degrees(np.arctan(wider * np.tan(np.radians(scene.camera.fov) / 2)))
    return replace(scene, camera=replace(scene.camera, fov=float(fov)))


def frame_times(rng: np.random.Generator, way: Way, seconds: float) -> np.ndarray:
    """(T,) s, from 0."""
    count = max(round(seconds * way.fps), 5)
    steps = (1 + way.varying * rng.uniform(-1, 1, count)) / way.fps
    return np.concatenate([[0.0], np.cumsum(steps)[:-1]])


def poses(scene: Scene, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, N, 3) m and quaternions (T, N, 4) at times, s: simulated from 0 on; before it, a body is brought to
    its start by a steady push from rest."""
    trace = simulate(scene, max(float(times.max()), 0.0) + 0.05)
    at = np.round(np.maximum(times, 0) * trace.rate).astype(int)
    early = np.minimum(times, 0)[:, None, None]
    velocity = np.array([o.velocity for o in scene.objects])
    return trace.position[at] + velocity * early * (1 + early / (2 * HELD)), trace.quaternion[at]
