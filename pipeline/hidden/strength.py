"""How strong a hidden effect is, in units of what could just be detected.

The detection limit of an effect in an experiment is three standard errors of its size, if all but the clips' initial
states (and the sliding friction, where it is fitted) were known. It follows from how far the effect moves the bodies
beyond what other initial states would do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.errors import SimulationError
from pipeline.hidden.events import run_events
from pipeline.hidden.law_perturbation import NO_PERTURBATION, LawPerturbation
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.scenario import BOUNCING, ON_THE_GROUND, Scenario
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.hiding import DETECTION_ERRORS, Launches, Setting
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject

PROBE_CLIPS = 4
SPIN_WEIGHT = 0.002  # m per rad/s: a spin is measured to about 1 rad/s, a position to about 2 mm
FRICTION_CHANGE = 0.97  # factor of the sliding friction whose effect on the motion is left out
GROUNDED_BELOW = 0.3  # m: bodies that start lower are on the ground


def scaled_effect(
    name: str, recipe: Recipe, scenario: Scenario, launches: Launches, times: np.ndarray, *, rng: np.random.Generator
) -> Effect:
    """The effect with random directions and places and with the recipe's strength, bounded to what is sane.

    Args:
        name: Of the effect.
        recipe: Its strength, in detection limits, and its noise, m.
        scenario: The experiment.
        launches: Of its clips.
        times: (T,) s, of the samples.
        rng: Draws directions and places.
    """
    hiding = effect_kinds()[name].hiding
    assert hiding is not None, f"{name} is not hidden in worlds"
    angle = rng.uniform(-np.pi, np.pi)
    across = np.array([np.cos(angle), np.sin(angle)])
    sign = float(rng.choice([-1.0, 1.0]))
    if hiding.draw is not None:
        return Effect(name, tuple(hiding.draw(launches, recipe.strength, sign, rng).items()))
    setting = _setting(scenario.bodies[0], across, sign, launches, rng)

    def of_size(size: float) -> Effect:
        assert hiding is not None and hiding.values is not None
        return Effect(name, tuple(hiding.values(size, setting).items()))

    unit = _displacement(of_size(1.0), scenario, launches, times)
    if unit <= 0:
        return of_size(hiding.largest)
    error = recipe.noise / unit / np.sqrt(len(launches) / min(len(launches), PROBE_CLIPS))
    return of_size(float(np.clip(recipe.strength * DETECTION_ERRORS * error, 0, hiding.largest)))


def size_beside(
    perturbation: LawPerturbation, effect: Effect, scenario: Scenario, launches: Launches, times: np.ndarray
) -> float:
    """How far an effect moves flying bodies beyond what other initial states would do, over how far a law does that
    beyond what more or less of the effect would do.

    Args:
        perturbation: The law.
        effect: Hidden in the same world.
        scenario: The experiment, in the air.
        launches: Of its clips.
        times: (T,) s, of the samples.
    """
    changes, own = [], []
    straight = np.column_stack([np.ones_like(times), times])
    project = np.eye(len(times)) - straight @ np.linalg.pinv(straight)
    for bodies in launches[:PROBE_CLIPS]:
        plain, moved = (run_events(Scene(bodies), times, law)[0] for law in (NO_PERTURBATION, perturbation))
        by_effect = run_events(Scene(bodies, effects=(effect,)), times)[0]
        changes.append(project @ (moved - plain).reshape(len(times), -1))
        own.append(project @ (by_effect - plain).reshape(len(times), -1))
    change, other = np.concatenate(changes).ravel(), np.concatenate(own).ravel()
    change = change - other * (other @ change) / (other @ other)
    return _displacement(effect, scenario, launches, times) / float(np.linalg.norm(change))


def _setting(
    ball: SceneObject, across: np.ndarray, sign: float, launches: Launches, rng: np.random.Generator
) -> Setting:
    """The random directions and places; all are drawn whatever the effect."""
    middle = np.mean([b[0].position for b in launches], 0) + np.array([0, 0, -1.0])
    place = middle + np.array([*(across * rng.uniform(0.8, 1.6)), rng.uniform(-0.5, 0.5)])
    wind = (*(across * rng.uniform(2, 4)), 0.0)
    when = float(rng.uniform(0.3, 0.6))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if launches[0][0].position[2] < GROUNDED_BELOW:
        direction[2] = 0
    return Setting(
        mass=ball.mass,
        radius=ball.size[0],
        sign=sign,
        across=across,
        direction=direction,
        place=place,
        wind=wind,
        time=when,
    )


def _displacement(effect: Effect, scenario: Scenario, launches: Launches, times: np.ndarray) -> float:
    """Root of the summed squared displacements by the effect in a few clips, m.

    They are taken in the air, or on the ground before a first impact, without what other initial positions and
    velocities (and another sliding friction, where it is fitted) would do.
    """
    kind = effect_kinds()[effect.name]
    assert kind.hiding is not None
    changes, frictions = [], []
    grounded = scenario.name in ON_THE_GROUND
    free_friction = grounded and "sliding_friction" in scenario.fit
    for bodies in launches[:PROBE_CLIPS]:
        try:
            hidden = (effect,) if kind.recording is None else ()
            if grounded:  # in MuJoCo pucks chatter, which would look like an effect
                a, b = (run_events(Scene(bodies, effects=e), times)[0] for e in ((), hidden))
                slicker = tuple(replace(o, sliding_friction=FRICTION_CHANGE * o.sliding_friction) for o in bodies)
                other = run_events(Scene(slicker), times)[0] if free_friction else a
            else:
                plain, moved = (simulate(Scene(bodies, effects=e), float(times[-1])) for e in ((), hidden))
                steps = np.rint(times * plain.rate).astype(int)
                a = other = plain.position[steps]
                b = moved.position[steps]
        except SimulationError:
            continue
        if kind.recording is not None:
            values = {k: np.array(v, float) for k, v in effect.parameters}
            shown, b = kind.recording(values, times, b)
            b = np.stack([np.stack([np.interp(times, shown, c) for c in one.T], 1) for one in b.transpose(1, 0, 2)], 1)
        if kind.hiding.shows_in_spin:
            turned = (moved.angular_velocity - plain.angular_velocity)[steps, 0, 2]
            changes.append(turned * SPIN_WEIGHT)
            frictions.append(0 * turned)
            continue
        keep = np.ones(len(times), bool)
        if scenario.name == BOUNCING:
            keep[np.argmax(a[:, 0, 2] < bodies[0].size[0] + 0.02) or len(times) :] = False
        design = np.column_stack([np.ones(keep.sum()), times[keep]])
        project = np.eye(keep.sum()) - design @ np.linalg.pinv(design)
        changes.append((project @ (b - a)[keep].reshape(keep.sum(), -1)).ravel())
        frictions.append((project @ (other - a)[keep].reshape(keep.sum(), -1)).ravel())
    if not changes:
        return 0.0
    change, friction = np.concatenate(changes), np.concatenate(frictions)
    if friction @ friction > 0:
        change = change - friction * (friction @ change) / (friction @ friction)
    return float(np.linalg.norm(change))
