"""A hidden world: measurements, what is known of the scene, and, apart from them, the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.discrepancy.known_scene import FITTED
from pipeline.discrepancy.track import Track
from pipeline.hidden.engine import BULLET_EFFECTS, ENGINES, EVENT_EFFECTS, Motion, Twist
from pipeline.hidden.scenario import SECONDS, Scenario, draw_name, draw_scenario, launch
from pipeline.hidden.strength import scaled_effect
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import SIZE_KEYS, Effect, Scene

FPS = 60
DROPOUTS, OUTLIERS = 0.10, 0.02
WRONG_LAWS = ("drag_slope", "spin_decay")
UNLISTED = ("cubic_drag", "swirl", "pulsed", "spring")


@dataclass(frozen=True)
class Recipe:
    """What a world is made of. effects: hidden names; strength: in detection limits; noise m; bounces: whether
    balls hit the ground; damaged: with dropouts and outliers; engine; wrong: one of `WRONG_LAWS`; unlisted: one of
    `UNLISTED`."""

    seed: int
    effects: tuple[str, ...]
    strength: float = 10.0
    noise: float = 0.002
    clips: int = 12
    bounces: bool = False
    damaged: bool = False
    engine: str = "mujoco"
    wrong: str | None = None
    unlisted: str | None = None


@dataclass(frozen=True)
class World:
    """tracks: measured motion. known: the scene file's content. truth: what nobody but the judge may see."""

    tracks: tuple[Track, ...]
    known: dict[str, Any]
    truth: dict[str, Any]


def make_world(recipe: Recipe, rng: np.random.Generator) -> World:
    """The world of a recipe; everything random comes from `rng`."""
    name = draw_name(recipe.effects, recipe.bounces, rng)
    if recipe.unlisted or recipe.wrong:  # of balls alone, for which there is an integrator that has such laws
        name = "bounce" if recipe.bounces else "throw"
    scenario = draw_scenario(name, recipe.effects, rng)
    shifted = bool(rng.random() < 0.3) and "impulse" not in recipe.effects  # a blow is sought at one time of all clips
    launches = [launch(scenario, rng) for _ in range(recipe.clips)]
    times = np.arange(round(SECONDS * FPS) + 1) / FPS
    engine = recipe.engine if _can(recipe, scenario) else "mujoco"
    effects: list[Effect] = []
    for effect in recipe.effects:
        effects.append(scaled_effect(effect, recipe.strength, recipe.noise, scenario, launches, times, rng))
    twist = _twist(recipe, scenario, rng)
    if not twist.plain or "adhesion" in recipe.effects:  # MuJoCo's pucks hop, and adhere only while they touch
        engine = "events"
    clips = []
    for number, bodies in enumerate(launches):
        start = rng.uniform(0, 5) if shifted else 0.0
        hidden = tuple(e for e in effects if effect_kinds()[e.name].recording is None)
        motion = ENGINES[engine](Scene(bodies, effects=hidden), times, twist)
        clips += _measured(f"clip_{number:02d}", motion, times, start, scenario, effects, recipe, rng)
    truth = {
        "effects": [{"name": e.name, **{k: _plain(v) for k, v in e.parameters}} for e in effects],
        "unlisted": recipe.unlisted, "wrong": recipe.wrong, "engine": engine, "scenario": scenario.name,
        "strength": recipe.strength, "noise": recipe.noise, "clips": recipe.clips, "seed": recipe.seed,
        "bounces": scenario.name == "bounce", "damaged": recipe.damaged,
    }  # fmt: skip
    return World(tuple(clips), known_scene_of(scenario), truth)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _can(recipe: Recipe, scenario: Scenario) -> bool:
    """Whether the recipe's engine has the effects and the bodies."""
    if recipe.engine == "bullet":
        return set(recipe.effects) <= set(BULLET_EFFECTS) and scenario.name in ("throw", "bounce", "pair")
    if recipe.engine != "events":
        return True
    return set(recipe.effects) <= set(EVENT_EFFECTS) and scenario.name not in ("cube", "spin", "carom")


def _twist(recipe: Recipe, scenario: Scenario, rng: np.random.Generator) -> Twist:
    if recipe.wrong == "drag_slope":
        return Twist(drag_slope=-0.03)
    if recipe.wrong == "spin_decay":
        return Twist(spin_decay=0.4)
    if recipe.unlisted is None:
        return Twist()
    size = recipe.strength / 10 * recipe.noise / 0.002
    angle = rng.uniform(-np.pi, np.pi)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])

    def extra(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        speed = np.linalg.norm(v, axis=-1, keepdims=True)
        if recipe.unlisted == "cubic_drag":
            return -0.004 * size * speed**3 * v / np.maximum(speed, 1e-9)
        if recipe.unlisted == "swirl":
            return 0.6 * size * np.stack([np.sin(3 * x[..., 1]), np.sin(3 * x[..., 2]), np.sin(3 * x[..., 0])], -1)
        if recipe.unlisted == "pulsed":
            return 1.2 * size * np.sin(2 * np.pi * 2.5 * t) * axis + 0 * x
        return -2.0 * size * (x - np.array([0, 0, 5.0]))

    return Twist(extra=extra)


def _measured(
    clip: str, motion: Motion, times: np.ndarray, start: float, scenario: Scenario, effects: list[Effect],
    recipe: Recipe,    rng: np.random.Generator,
) -> list[Track]:  # fmt: skip
    """What a recording of the motion shows: clock and ruler, noise, dropouts, outliers."""
    tracks = []
    for i, body in enumerate(scenario.bodies):
        shown, position = times + start, motion.position[:, i].copy()
        for e in effects:
            kind = effect_kinds()[e.name]
            if kind.recording is not None:
                values = {k: np.array(v, float) for k, v in e.parameters}
                shown, position = kind.recording(values, shown, position)
        position += rng.normal(0, recipe.noise, position.shape)
        kept = np.ones(len(times), bool)
        if recipe.damaged:
            wild = rng.random(len(times)) < OUTLIERS
            position[wild] += rng.normal(0, 1, (int(wild.sum()), 3)) * max(40 * recipe.noise, 0.05)
            kept = rng.random(len(times)) >= DROPOUTS
        spin = motion.angular_velocity[:, i] * (1 + rng.normal(0, 0.01)) if scenario.spin else None
        turn = motion.quaternion[:, i] if scenario.orientation else None
        if turn is not None:
            turn = turn + rng.normal(0, recipe.noise / 0.2 / 2, turn.shape)
            turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        tracks.append(Track(clip, body.name, shown[kept], position[kept], None if turn is None else turn[kept],
                            None if spin is None else spin[kept]))  # fmt: skip
    return tracks


def known_scene_of(scenario: Scenario) -> dict[str, Any]:
    """The scene file: shapes, sizes, masses; contact numbers only where they are not fitted."""
    objects = []
    for body in scenario.bodies:
        entry: dict[str, Any] = {"name": body.name, "shape": body.shape}
        entry |= dict(zip(SIZE_KEYS[body.shape], map(float, body.size), strict=True))
        entry["mass"] = float(body.mass)
        entry |= {key: float(getattr(body, key)) for key in FITTED if key not in scenario.fit}
        objects.append(entry)
    return {"objects": objects, "fit": list(scenario.fit)}


def blind(world: World) -> World:
    """The world without its truth."""
    return replace(world, truth={})
