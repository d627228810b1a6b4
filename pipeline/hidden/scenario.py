"""Kinds of experiment, and the bodies and launches of one.

Balls that fly or bounce, balls and pucks on the ground, tossed cubes, pairs of balls in the air, and three balls that
collide on the ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.tracks.known_scene import FITTED
from pipeline.scene.effects.discovery_rules import Experiment, Need
from pipeline.scene.effects.hiding import FLYING
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import SceneObject

SECONDS = 1.0
THROW_HEIGHT = 6.5  # m, mean; thrown balls do not reach the ground
BOUNCING = "bounce"
EVERY = ("throw", BOUNCING, "cube", "pair", "puck", "roll", "spin", "carom")
ON_THE_GROUND = ("puck", "roll", "carom")
"""On the ground from the start, with positions that show an effect."""
TWO_OR_THREE = ("pair", "carom")
"""Experiments with several bodies."""


@dataclass(frozen=True)
class Scenario:
    """An experiment.

    Attributes:
        name: One of `EVERY`.
        bodies: What is launched in each clip, without its motion.
        spin: Whether spins are measured.
        orientation: Whether orientations are measured.
        fit: The contact numbers that the known scene lets be fitted; it states the others.
    """

    name: str
    bodies: tuple[SceneObject, ...]
    spin: bool = False
    orientation: bool = False
    fit: tuple[str, ...] = FITTED


def experiment_of(scenario: str, clips: int) -> Experiment:
    """What of an experiment decides which effects are equal in it."""
    return Experiment(
        in_the_air=scenario in (*FLYING, BOUNCING),
        one_body=scenario not in TWO_OR_THREE,
        sliding=scenario == "puck",
        clips=clips,
    )


def draw_name(effects: Sequence[str], bounces: bool, rng: np.random.Generator) -> str:
    """An experiment in which the effects show; any where there are none.

    bounces: with impacts, where the first effect shows in the air.
    """
    if not effects:
        return str(rng.choice(EVERY))
    hiding = effect_kinds()[effects[0]].hiding
    choices = FLYING if hiding is None else hiding.scenarios
    return BOUNCING if bounces and "throw" in choices and len(choices) > 1 else str(rng.choice(choices))


def draw_fit(effects: Sequence[str], rng: np.random.Generator) -> tuple[str, ...]:
    """The contact numbers that are not known: any but those that could stand for a hidden effect."""
    known = {name for kind in _kinds(effects) for name in kind.discovery.needs_known}
    while True:
        fit = tuple(key for key in FITTED if rng.random() < 0.5)
        if not known & set(fit):
            return fit


def draw_scenario(name: str, effects: Sequence[str], rng: np.random.Generator) -> Scenario:
    """A scenario with bodies of random size, mass and contact numbers.

    What is measured and known has the same distribution whatever is hidden; only draws in which nothing could show the
    effect are excluded.
    """
    radius, mass = rng.uniform(0.03, 0.11), np.exp(rng.uniform(np.log(0.05), np.log(0.6)))
    friction, damping = rng.uniform(0.15, 0.6), rng.uniform(0.05, 0.35)
    needs = {need for kind in _kinds(effects) for need in kind.discovery.needs}
    spin = Need.SPIN in needs or name == "spin" or bool(rng.random() < 0.5)
    turn = Need.ORIENTATION in needs or bool(rng.random() < 0.5)
    fit = draw_fit(effects, rng)
    ball = SceneObject("sphere", (radius,), mass, friction, damping=damping, name="ball")
    if name == "puck":
        return Scenario(name, (SceneObject("cylinder", (radius, 0.4 * radius), mass, friction, name="puck"),), fit=fit)
    if name == "cube":
        cube = SceneObject("box", (2 * radius,) * 3, mass, friction, name="cube")
        return Scenario(name, (cube,), spin, turn or not spin, fit)
    if name in TWO_OR_THREE:
        more = ("other", "third")[: 1 if name == "pair" else 2]
        others = tuple(replace(ball, name=n, mass=float(mass * rng.uniform(0.6, 1.6))) for n in more)
        return Scenario(name, (ball, *others), spin, fit=fit)
    return Scenario(name, (ball,), spin, fit=fit)


def _kinds(effects: Sequence[str]) -> list[EffectKind]:
    return [effect_kinds()[e] for e in effects]


def launch(scenario: Scenario, rng: np.random.Generator) -> tuple[SceneObject, ...]:
    """The bodies with the initial states of one clip."""
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
    if name == "carom":
        return _carom(scenario.bodies, across, rng)
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
    start = (*rng.normal(0, 0.4, 2), rng.uniform(THROW_HEIGHT - 0.5, THROW_HEIGHT + 0.5))
    velocity = across * speed + np.array([0, 0, rng.uniform(-0.5, 3.0)])
    orientation = tuple(rng.normal(size=4)) if name == "cube" else (1.0, 0, 0, 0)
    return (replace(_moving(first, start, velocity, spin), orientation=orientation),)


def _carom(bodies: tuple[SceneObject, ...], across: np.ndarray, rng: np.random.Generator) -> tuple[SceneObject, ...]:
    """One ball rolls at a second, which is at rest and may be driven into a third."""
    r = bodies[0].size[0]
    side = np.cross([0, 0, 1.0], across)
    start = np.array([*rng.normal(0, 0.2, 2), r])
    velocity = rng.uniform(1.0, 2.5) * across
    second = start + across * (2 * r + rng.uniform(0.25, 0.5)) + side * rng.uniform(-0.8, 0.8) * r
    third = second + across * (2 * r + rng.uniform(0.05, 0.3)) + side * rng.uniform(-1.5, 1.5) * r
    rolling = np.array([-velocity[1], velocity[0], 0]) / r
    still = np.zeros(3)
    return (
        _moving(bodies[0], start, velocity, rolling),
        _moving(bodies[1], second, still, still),
        _moving(bodies[2], third, still, still),
    )


def _moving(
    body: SceneObject, position: np.ndarray | tuple[float, ...], velocity: np.ndarray, spin: np.ndarray
) -> SceneObject:
    return replace(body, position=tuple(position), velocity=tuple(velocity), angular_velocity=tuple(spin))
