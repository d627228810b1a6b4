"""Worlds in which the known scene fails in a part only: after a time, in a place, above a speed, of one body.

Pucks that slide on a table and balls that fly, twelve recordings of one second, 60 positions a second with 2 mm of
noise. Half of the worlds are made by MuJoCo, half by our own integrator (`pipeline.hidden.events`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.discovery.tracks.track import Track
from pipeline.hidden.events import run_events
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.region import Region
from pipeline.scene.scene import Effect, Scene, SceneObject

CLIPS, FPS, SECONDS, NOISE = 12, 60, 1.0, 0.002
STRENGTHS = {"weak": 0.5, "medium": 1.0, "strong": 2.0}
GRAVITY = 9.81
HIT_SPEED = 0.1  # m/s between two samples: friction changes a velocity by less
LEAST_SPEED = 0.05  # m/s: friction and drag act on nothing slower


@dataclass(frozen=True)
class LocalWorld:
    """A world with the truth of it.

    Attributes:
        kind: Of KINDS.
        effects: What is hidden, each with where it acts.
        tracks: Measured.
        known: The scene file's content.
        friction: Of the pucks elsewhere; None of balls in the air.
        acts: (clip, object) -> (T,) bool at the times of its track, when something hidden acts.
    """

    kind: str
    effects: tuple[Effect, ...]
    tracks: tuple[Track, ...]
    known: dict[str, Any]
    friction: float | None
    acts: dict[tuple[str, str], np.ndarray]


Draw = Callable[[np.random.Generator, float, float], tuple[Effect, ...]]
"""(rng, strength, mass in kg) -> the hidden effects."""


def _disc(rng: np.random.Generator, radius: tuple[float, float] = (0.15, 0.3)) -> Region:
    return Region(centre=(*rng.uniform(-0.4, 0.4, 2), 0.01), radius=float(rng.uniform(*radius)))


def _half(rng: np.random.Generator) -> Region:
    angle = rng.uniform(0, 2 * np.pi)
    return Region(normal=(float(np.cos(angle)), float(np.sin(angle)), 0.0), offset=float(rng.uniform(0.0, 0.3)))


def _effect(name: str, only: Region | None, objects: tuple[str, ...] | None = None, **values: Any) -> Effect:
    return Effect(name, tuple(values.items()), objects, only)


def _patch(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (_effect("friction_error", _disc(rng), coefficient=0.1 + 0.1 * s),)


def _bent(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    angle = rng.uniform(0, 2 * np.pi)
    tilt = 0.04 * s * np.array([np.cos(angle), np.sin(angle)])
    return (_effect("tilted_gravity", _half(rng), tilt=tuple(tilt)),)


def _viscous_puck(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (_effect("viscous_friction", None, ("puck_a",), coefficient=0.4 * s * mass),)


def _kick(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    angle = rng.uniform(0, 2 * np.pi)
    push = 0.2 * s * mass * np.array([np.cos(angle), np.sin(angle), 0.0])
    return (_effect("impulse", None, time=float(rng.uniform(0.2, 0.4)), momentum=tuple(push)),)


def _pull(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    region = _disc(rng, (0.2, 0.3))
    assert region.centre is not None
    place = (*region.centre[:2], 0.3)
    return (_effect("hidden_attractor", region, position=place, strength=0.15 * s * mass),)


def _parachute(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (_effect("air_drag", Region(after=float(rng.uniform(0.3, 0.6))), coefficient=0.1 * s * mass),)


def _fast(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (_effect("air_drag", Region(faster=float(rng.uniform(3.0, 5.0))), coefficient=0.08 * s * mass),)


def _stream(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    region = Region(normal=(0.0, 1.0, 0.0), offset=float(rng.uniform(0.2, 0.5)))
    way = rng.uniform(0, 2 * np.pi)
    wind = 3.0 * np.array([np.cos(way), np.sin(way), 0.0])
    return (_effect("wind", region, velocity=tuple(wind), coefficient=0.08 * s * mass),)


def _post(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (_effect("hidden_obstacle", None, position=(*rng.uniform(-0.3, 0.3, 2), 0.02), size=0.05 + 0.02 * s),)


def _two(rng: np.random.Generator, s: float, mass: float) -> tuple[Effect, ...]:
    return (*_patch(rng, s, mass), *_kick(rng, s, mass))


#: Whether balls fly, how many pucks there are in a recording, and what is hidden.
KINDS: dict[str, tuple[bool, int, Draw]] = {
    "rough patch": (False, 1, _patch),
    "bent table": (False, 1, _bent),
    "one viscous puck": (False, 2, _viscous_puck),
    "kick": (False, 1, _kick),
    "short pull": (False, 1, _pull),
    "late parachute": (True, 1, _parachute),
    "drag above a speed": (True, 1, _fast),
    "stream of air": (True, 1, _stream),
    "post": (False, 1, _post),
    "patch and kick": (False, 1, _two),
}


def make_local_world(seed: int, kind: str, strength: str) -> LocalWorld:
    """A world of a kind and a strength; its integrator depends on the seed."""
    rng = np.random.default_rng(
        np.random.SeedSequence((seed, list(KINDS).index(kind), list(STRENGTHS).index(strength)))
    )
    flies, count, draw = KINDS[kind]
    mass, friction = float(rng.uniform(0.05, 0.4)), float(rng.uniform(0.08, 0.16))
    hidden = draw(rng, STRENGTHS[strength], mass)
    names = [f"puck_{'ab'[k]}" for k in range(count)] if count > 1 else ["ball" if flies else "puck"]
    times = np.arange(round(SECONDS * FPS) + 1) / FPS
    tracks, acts = [], {}
    for c in range(CLIPS):
        bodies = tuple(_body(rng, name, k, flies, mass, friction) for k, name in enumerate(names))
        acting = tuple(e for e in hidden if e.name != "impulse" or c % 3 == 0)  # a blow in some recordings
        scene = Scene(bodies, effects=acting)
        position, velocity = _simulated(scene, times, own=seed % 2 == 0 or kind == "post")
        for k, name in enumerate(names):
            measured = position[:, k] + rng.normal(0, NOISE, position[:, k].shape)
            tracks.append(Track(f"clip_{c:02d}", name, times, measured))
            acts[f"clip_{c:02d}", name] = _acting(acting, name, times, position[:, k], velocity[:, k], flies)
    shape = {"shape": "sphere", "radius": 0.05} if flies else {"shape": "cylinder", "radius": 0.04, "height": 0.03}
    known: dict[str, Any] = {"objects": [{"name": n, **shape, "mass": mass} for n in names]}
    if flies:
        known["ground"] = None
    else:
        known["fit"] = ["sliding_friction"]
    return LocalWorld(kind, hidden, tuple(tracks), known, None if flies else friction, acts)


def _body(rng: np.random.Generator, name: str, number: int, flies: bool, mass: float, friction: float) -> SceneObject:
    angle = rng.uniform(0, 2 * np.pi)
    if flies:
        speed = rng.uniform(2.0, 5.0)
        velocity = (speed * np.cos(angle), speed * np.sin(angle), rng.uniform(2.0, 4.0))
        return SceneObject("sphere", (0.05,), mass, friction, position=(0, 0, 3.0), velocity=velocity, name=name)
    side = 1.5 * number  # apart, so that they do not meet
    start = np.array([side, 0.0]) + rng.uniform(-0.5, 0.5, 2)
    aim = np.array([side, 0.0]) + rng.uniform(-0.25, 0.25, 2) - start
    velocity = (*(rng.uniform(0.8, 2.2) * aim / np.linalg.norm(aim)), 0.0)
    return SceneObject("cylinder", (0.04, 0.03), mass, friction, position=(*start, 0.015), velocity=velocity, name=name)


def _simulated(scene: Scene, times: np.ndarray, own: bool) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (T, N, 3), by our integrator or by MuJoCo."""
    if own:
        position = run_events(scene, times)[0]
        return position, np.gradient(position, times, axis=0)
    trace = simulate(replace(scene, ground=0.0), float(times[-1]) + 0.02)
    at = np.round(times * trace.rate).astype(int)
    return trace.position[at], trace.velocity[at]


def _acting(
    effects: tuple[Effect, ...],
    name: str,
    times: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    flies: bool,
) -> np.ndarray:
    """(T,) bool: when something hidden acts on a body; on one that rests nothing does."""
    out = np.zeros(len(times), bool)
    moves = np.linalg.norm(velocity, axis=1) > LEAST_SPEED
    for e in effects:
        if e.objects is not None and name not in e.objects:
            continue
        if e.name == "impulse":
            out |= np.abs(times - e.values["time"]) <= 0.5 / FPS
        elif e.name == "hidden_obstacle":
            jump = np.linalg.norm(np.diff(velocity, axis=0), axis=1) > HIT_SPEED
            out[1:] |= jump
        elif e.only is None:
            out |= moves
        else:
            out |= moves & e.only.holds(times, position, velocity)
    return out
