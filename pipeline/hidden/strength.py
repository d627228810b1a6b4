"""How strong a hidden effect is, in units of what could just be detected.

The detection limit of an effect in an experiment is three standard errors of its size, were all else but the clips'
initial states (and the sliding friction, where it is fitted) known: from how far it moves the bodies beyond what these
would do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.errors import SimulationError
from pipeline.hidden.events import run_events
from pipeline.hidden.experiment import ON_THE_GROUND
from pipeline.hidden.scenario import Scenario
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, Scene, SceneObject

LIMIT_ERRORS = 3.0  # standard errors
PROBE_CLIPS = 4
Launches = Sequence[tuple[SceneObject, ...]]


def scaled_effect(
    name: str, strength: float, noise: float, scenario: Scenario, launches: Launches, times: np.ndarray,
    rng: np.random.Generator,
) -> Effect:  # fmt: skip
    """The effect with random directions and places, of a size of `strength` detection limits (bounded to what is
    sane)."""
    ball = scenario.bodies[0]
    angle = rng.uniform(-np.pi, np.pi)
    across = np.array([np.cos(angle), np.sin(angle)])
    sign = float(rng.choice([-1.0, 1.0]))
    if name == "restitution":
        from pipeline.scene.effects.kinds.restitution import restitution_of

        before = restitution_of(ball.damping)
        step = min(strength * LIMIT_ERRORS * 0.06 / np.sqrt(2.0 * len(launches)), 0.35)
        value = before - step if before - step > 0.15 and (sign < 0 or before + step > 0.93) else before + step
        return Effect(name, (("coefficient", float(np.clip(value, 0.1, 0.95))),))
    if name == "hidden_obstacle":
        return _obstacle(launches, strength, rng)
    probe, most = _probe(name, ball, across, sign, launches, rng)
    unit = _moved(probe(1.0), scenario, launches, times)
    if unit <= 0:
        return probe(most)
    error = noise / unit / np.sqrt(len(launches) / min(len(launches), PROBE_CLIPS))
    return probe(float(np.clip(strength * LIMIT_ERRORS * error, 0, most)))


def _probe(name: str, ball: SceneObject, across: np.ndarray, sign: float, launches: Launches, rng: np.random.Generator):  # type: ignore[no-untyped-def]
    """The effect as a function of its size, in units that are sane for this body; and the largest size."""
    m, r = ball.mass, ball.size[0]

    def effect(**values: object) -> Effect:
        return Effect(name, tuple(values.items()))

    middle = np.mean([b[0].position for b in launches], 0) + np.array([0, 0, -1.0])
    place = middle + np.array([*(across * rng.uniform(0.8, 1.6)), rng.uniform(-0.5, 0.5)])
    wind = (*(across * rng.uniform(2, 4)), 0.0)
    when = float(rng.uniform(0.3, 0.6))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if launches[0][0].position[2] < 0.3:
        direction[2] = 0
    table = {
        "air_drag": (lambda s: effect(coefficient=0.02 * s * m), 15.0),
        "linear_drag": (lambda s: effect(coefficient=0.1 * s * m), 15.0),
        "wind": (lambda s: effect(velocity=wind, coefficient=0.02 * s * m), 15.0),
        "magnus_lift": (lambda s: effect(coefficient=0.005 * s * m * sign), 15.0),
        "buoyancy": (lambda s: effect(fraction=0.05 * s), 10.0),
        "gravity_error": (lambda s: effect(gravity=9.81 + sign * 0.5 * s), 8.0),
        "tilted_gravity": (lambda s: effect(tilt=tuple(0.03 * s * across)), 10.0),
        "rolling_resistance": (lambda s: effect(coefficient=0.01 * s * r), 15.0),
        "spin_friction": (lambda s: effect(coefficient=0.05 * s * r), 10.0),
        "viscous_friction": (lambda s: effect(coefficient=0.1 * s * m), 20.0),
        "anisotropic_friction": (
            lambda s: effect(ratio=1 - 0.05 * s, angle=float(np.arctan(across[1] / across[0]))),
            16.0,
        ),
        "off_center_mass": (lambda s: effect(offset=tuple(0.02 * s * r * _body_axis(direction, rng))), 15.0),
        "hidden_attractor": (lambda s: effect(position=tuple(place), strength=sign * 0.3 * s * m), 12.0),
        "pair_attraction": (lambda s: effect(strength=sign * 0.02 * s * m), 8.0),
        "moving_ground": (lambda s: effect(velocity=tuple(0.05 * s * across)), 15.0),
        "rotating_frame": (lambda s: effect(angular_velocity=0.05 * s * sign), 15.0),
        "impulse": (lambda s: effect(time=when, momentum=tuple(0.1 * s * m * direction)), 15.0),
        "adhesion": (lambda s: effect(force=0.1 * s * m * 9.81), 15.0),
        "clock_rate": (lambda s: effect(ratio=1 + sign * 0.02 * s), 8.0),
        "length_scale": (lambda s: effect(ratio=1 + sign * 0.02 * s), 8.0),
    }
    return table[name]


def _body_axis(direction: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return direction


def _moved(effect: Effect, scenario: Scenario, launches: Launches, times: np.ndarray) -> float:
    """Root of the summed squared displacements that the effect makes in a few clips, in the air or on the ground
    before a first impact, beyond those of other initial positions and velocities, m."""
    kind = effect_kinds()[effect.name]
    changes, frictions = [], []
    grounded = scenario.name in ON_THE_GROUND
    rub = grounded and "sliding_friction" in scenario.fit
    for bodies in launches[:PROBE_CLIPS]:
        try:
            hidden = (effect,) if kind.recording is None else ()
            if grounded:  # in MuJoCo pucks chatter, which would look like an effect
                a, b = (run_events(Scene(bodies, effects=e), times)[0] for e in ((), hidden))
                slicker = tuple(replace(body, sliding_friction=0.97 * body.sliding_friction) for body in bodies)
                other = run_events(Scene(slicker), times)[0] if rub else a
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
        if effect.name == "spin_friction":
            turned = (moved.angular_velocity - plain.angular_velocity)[steps, 0, 2]
            changes.append(turned * 0.002)  # a spin is measured to about 1 rad/s
            frictions.append(0 * turned)
            continue
        keep = np.ones(len(times), bool)
        if scenario.name == "bounce":
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


def _obstacle(launches: Launches, strength: float, rng: np.random.Generator) -> Effect:
    """A sphere in the way of some of the bodies: the weaker, the smaller."""
    size = {3: 0.12, 10: 0.25}.get(round(strength), 0.45)
    bodies = launches[int(rng.integers(len(launches)))]
    b, t = bodies[0], float(rng.uniform(0.35, 0.6))
    path = np.array(b.position) + t * np.array(b.velocity) - np.array([0, 0, 9.81 / 2 * t * t])
    velocity = np.array(b.velocity) - np.array([0, 0, 9.81 * t])
    aside = rng.normal(size=3) * 0.25
    ahead = velocity / np.linalg.norm(velocity) + aside
    place = path + ahead / np.linalg.norm(ahead) * (size + b.size[0])
    return Effect("hidden_obstacle", (("position", tuple(place)), ("size", size)))
