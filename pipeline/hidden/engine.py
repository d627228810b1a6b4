"""The engines that make hidden motion: MuJoCo, an integrator of our own with event-driven impacts, Bullet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.hidden.bullet import run_bullet
from pipeline.hidden.events import run_events
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class Motion:
    """States of N objects at T times: position (T, N, 3) m, quaternion (T, N, 4), angular_velocity (T, N, 3) rad/s."""

    position: np.ndarray
    quaternion: np.ndarray
    angular_velocity: np.ndarray


@dataclass(frozen=True)
class Twist:
    """How the hidden law departs from the named one. drag_slope: change of the drag coefficient per m/s, relative;
    spin_decay: 1/s; extra: an acceleration that is in no list, (time, position, velocity) -> m/s²."""

    drag_slope: float = 0.0
    spin_decay: float = 0.0
    extra: Callable[[float, np.ndarray, np.ndarray], np.ndarray] | None = None

    @property
    def plain(self) -> bool:
        return self == Twist()


def run_mujoco(scene: Scene, times: np.ndarray, twist: Twist) -> Motion:
    """By MuJoCo, 240 steps a second, linear between them."""
    assert twist.plain, "MuJoCo runs the laws as they are named"
    trace = simulate(scene, float(times[-1]) + 2 / 240)
    place = times * trace.rate
    k = np.minimum(place.astype(int), len(trace.position) - 2)
    u = (place - k)[:, None, None]
    blend = [(1 - u) * a[k] + u * a[k + 1] for a in (trace.position, trace.quaternion, trace.angular_velocity)]
    quaternion = blend[1] / np.linalg.norm(blend[1], axis=-1, keepdims=True)
    return Motion(blend[0], quaternion, blend[2])


def run_event_driven(scene: Scene, times: np.ndarray, twist: Twist) -> Motion:
    """By our own integrator: balls and pucks, instant impacts."""
    position, spin = run_events(scene, times, twist.drag_slope, twist.spin_decay, twist.extra)
    quaternion = np.tile([1.0, 0, 0, 0], (*position.shape[:2], 1))
    return Motion(position, quaternion, spin)


def run_with_bullet(scene: Scene, times: np.ndarray, twist: Twist) -> Motion:
    """By Bullet, where it is installed."""
    assert twist.plain, "Bullet runs the laws as they are named"
    return Motion(*run_bullet(scene, times))


ENGINES: dict[str, Callable[[Scene, np.ndarray, Twist], Motion]] = {
    "mujoco": run_mujoco,
    "events": run_event_driven,
    "bullet": run_with_bullet,
}
EVENT_EFFECTS = (
    "air_drag", "linear_drag", "wind", "magnus_lift", "buoyancy", "gravity_error", "tilted_gravity", "restitution",
    "hidden_attractor", "pair_attraction", "rotating_frame", "impulse", "clock_rate", "length_scale", "hidden_obstacle",
    "viscous_friction", "moving_ground", "rolling_resistance", "anisotropic_friction", "adhesion",
)  # fmt: skip
"""What the event-driven integrator can hide."""
BULLET_EFFECTS = (
    "air_drag", "linear_drag", "wind", "magnus_lift", "buoyancy", "gravity_error", "tilted_gravity", "hidden_attractor",
    "pair_attraction", "rotating_frame", "clock_rate", "length_scale",
)  # fmt: skip
"""What Bullet is used for: forces on bodies in the air."""
