"""The engines that simulate hidden motion: MuJoCo, an integrator of our own with instantaneous impacts, and Bullet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pipeline.hidden.bullet import RATE, run_bullet
from pipeline.hidden.events import run_events
from pipeline.hidden.law_perturbation import LawPerturbation
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import STEPS_PER_SECOND


@dataclass(frozen=True)
class SimulatedMotion:
    """States of N objects at T times: position (T, N, 3) m, quaternion (T, N, 4), angular_velocity (T, N, 3) rad/s."""

    position: np.ndarray
    quaternion: np.ndarray
    angular_velocity: np.ndarray


def run_mujoco(scene: Scene, times: np.ndarray, perturbation: LawPerturbation) -> SimulatedMotion:
    """By MuJoCo, interpolated linearly."""
    assert perturbation.is_none, "MuJoCo runs the laws as they are named"
    trace = simulate(scene, float(times[-1]) + 2 / STEPS_PER_SECOND)
    return _at(times, trace.rate, trace.position, trace.quaternion, trace.angular_velocity)


def run_event_driven(scene: Scene, times: np.ndarray, perturbation: LawPerturbation) -> SimulatedMotion:
    """By our own integrator: balls and pucks, instantaneous impacts."""
    position, spin = run_events(scene, times, perturbation)
    quaternion = np.tile([1.0, 0, 0, 0], (*position.shape[:2], 1))
    return SimulatedMotion(position, quaternion, spin)


def run_with_bullet(scene: Scene, times: np.ndarray, perturbation: LawPerturbation) -> SimulatedMotion:
    """By Bullet, where it is installed, interpolated linearly."""
    assert perturbation.is_none, "Bullet runs the laws as they are named"
    return _at(times, RATE, *run_bullet(scene, float(times[-1])))


def _at(times: np.ndarray, rate: int, *states: np.ndarray) -> SimulatedMotion:
    """The motion at times (T,), s, between states of `rate` steps a second: positions, quaternions, spins."""
    place = times * rate
    k = np.minimum(place.astype(int), len(states[0]) - 2)
    u = (place - k)[:, None, None]
    position, quaternion, spin = ((1 - u) * a[k] + u * a[k + 1] for a in states)
    return SimulatedMotion(position, quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), spin)


ENGINES: dict[str, Callable[[Scene, np.ndarray, LawPerturbation], SimulatedMotion]] = {
    "mujoco": run_mujoco,
    "events": run_event_driven,
    "bullet": run_with_bullet,
}


def can_simulate(engine: str, effects: Iterable[str]) -> bool:
    """Whether an engine can simulate all of the effects in hidden worlds."""
    kinds = effect_kinds()
    return all((hiding := kinds[e].hiding) is not None and engine in hiding.engines for e in effects)
