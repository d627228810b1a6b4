"""What is launched: balls that fly or bounce, balls and pucks on the ground, tossed cubes, pairs of balls."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.scene import SceneObject

SECONDS = 1.0


@dataclass(frozen=True)
class Scenario:
    """A kind of experiment. bodies: what is launched in each clip, before its motion is drawn. spin, orientation:
    what is measured beside positions. fit: what the known scene lets be fitted."""

    name: str
    bodies: tuple[SceneObject, ...]
    spin: bool = False
    orientation: bool = False
    fit: tuple[str, ...] | None = None


#: Effect -> the kinds of experiment in which it shows.
SCENARIOS: dict[str, tuple[str, ...]] = {
    "rolling_resistance": ("roll",),
    "spin_friction": ("spin",),
    "viscous_friction": ("puck",),
    "anisotropic_friction": ("puck",),
    "moving_ground": ("puck",),
    "adhesion": ("puck",),
    "restitution": ("bounce",),
    "off_center_mass": ("cube",),
    "pair_attraction": ("pair",),
    "hidden_obstacle": ("throw",),
}
FLYING = ("throw", "bounce")
KNOWN_FIT: dict[str, tuple[str, ...]] = {
    "rolling_resistance": ("sliding_friction", "damping"),
    "restitution": ("sliding_friction", "rolling_friction"),
    "adhesion": ("rolling_friction", "damping"),
}
"""Parameters left free, where the default's frictions and damping would be the effect by another name."""


def draw_scenario(name: str, effect: str | None, rng: np.random.Generator) -> Scenario:
    """A scenario with bodies of random size, mass and contact numbers."""
    radius, mass = rng.uniform(0.03, 0.11), np.exp(rng.uniform(np.log(0.05), np.log(0.6)))
    friction, damping = rng.uniform(0.15, 0.6), rng.uniform(0.05, 0.35)
    ball = SceneObject("sphere", (radius,), mass, friction, 0.0, damping, name="ball")
    spin = effect == "magnus_lift" or name == "spin" or bool(rng.random() < 0.3)
    fit = KNOWN_FIT.get(effect or "")
    if name == "puck":
        return Scenario(name, (SceneObject("cylinder", (radius, 0.4 * radius), mass, friction, name="puck"),), fit=fit)
    if name == "cube":
        side = 2 * radius
        return Scenario(
            name, (SceneObject("box", (side,) * 3, mass, friction, name="cube"),), orientation=True, fit=fit
        )
    if name == "pair":
        return Scenario(
            name, (ball, replace(ball, name="other", mass=float(mass * rng.uniform(0.6, 1.6)))), spin, fit=fit
        )
    return Scenario(name, (ball,), spin, fit=fit)


def launch(scenario: Scenario, rng: np.random.Generator, drag_free_height: float = 6.5) -> tuple[SceneObject, ...]:
    """The bodies with the positions and velocities of one clip."""
    first = scenario.bodies[0]
    angle = rng.uniform(-np.pi, np.pi)
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    name = scenario.name
    if name in ("puck", "roll", "spin"):
        height = first.size[0] if first.shape == "sphere" else first.size[1] / 2
        speed = {"puck": rng.uniform(0.6, 3.0), "roll": rng.uniform(0.4, 2.0), "spin": rng.uniform(0.0, 0.3)}[name]
        velocity = speed * across
        spin = np.zeros(3)
        if first.shape == "sphere":
            spin = np.array([-velocity[1], velocity[0], 0]) / height
        if name == "spin":
            spin = spin + np.array([0, 0, rng.choice([-1, 1]) * rng.uniform(15, 40)])
        start = (*rng.normal(0, 0.3, 2), height)
        return (_moving(first, start, velocity, spin),)
    if name == "pair":
        middle = np.array([*rng.normal(0, 0.2, 2), rng.uniform(3.5, 4.5)])
        gap = rng.uniform(0.35, 0.6) * across
        shared = np.array([*rng.normal(0, 0.7, 2), rng.uniform(0, 2)])
        drift = np.cross(across, [0, 0, 1]) * rng.uniform(-0.3, 0.3) + across * rng.uniform(-0.15, 0.1)
        sides = (-1, 1)
        return tuple(
            _moving(b, middle + s * gap / 2, shared + s * drift, rng.normal(0, 10, 3))
            for b, s in zip(scenario.bodies, sides, strict=True)
        )
    speed, spin = rng.uniform(1.5, 6.0), rng.normal(0, 18, 3)
    if name == "bounce":
        start = (*rng.normal(0, 0.3, 2), first.size[0] + rng.uniform(0.3, 1.0))
        velocity = across * rng.uniform(0.5, 3.0) + np.array([0, 0, rng.uniform(-1.0, 1.5)])
        return (_moving(first, start, velocity, spin),)
    start = (*rng.normal(0, 0.4, 2), rng.uniform(drag_free_height - 0.5, drag_free_height + 0.5))
    velocity = across * speed + np.array([0, 0, rng.uniform(-0.5, 3.0)])
    orientation = tuple(rng.normal(size=4)) if name == "cube" else (1.0, 0, 0, 0)
    return (replace(_moving(first, start, velocity, spin), orientation=orientation),)


def _moving(
    body: SceneObject, position: np.ndarray | tuple[float, ...], velocity: np.ndarray, spin: np.ndarray
) -> SceneObject:
    return replace(body, position=tuple(position), velocity=tuple(velocity), angular_velocity=tuple(spin))
