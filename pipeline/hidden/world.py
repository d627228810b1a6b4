"""A hidden world: measurements, what is known of the scene, and, apart from them, the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pipeline.discovery.tracks.known_scene import FITTED
from pipeline.discovery.tracks.track import Track
from pipeline.hidden.engine import ENGINES, SimulatedMotion, can_simulate
from pipeline.hidden.law_perturbation import draw_perturbation
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.scenario import BOUNCING, SECONDS, Scenario, draw_name, draw_scenario, launch
from pipeline.hidden.strength import scaled_effect, size_beside
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import SIZE_KEYS, Effect, Scene

FPS = 60
DROPOUTS, OUTLIERS = 0.10, 0.02


@dataclass(frozen=True)
class World:
    """tracks: measured motion. known: the scene file's content. truth: what only the judge may see."""

    tracks: tuple[Track, ...]
    known: dict[str, Any]
    truth: dict[str, Any]


def make_world(recipe: Recipe, rng: np.random.Generator, more: Sequence[Sequence[Mapping[str, Any]]] = ()) -> World:
    """The world of a recipe.

    Args:
        recipe: What it is made of.
        rng: Everything random comes from it.
        more: Further recordings: of each, the initial state of each body that is not as in the first recording, by the
            names of its attributes.
    """
    kinds = [effect_kinds()[name] for name in recipe.effects]
    name = draw_name(recipe.effects, recipe.bounces, rng)
    balls_alone = recipe.unlisted or recipe.wrong  # only our own integrator has such laws
    if balls_alone or recipe.spin_measured is not None:
        name = BOUNCING if recipe.bounces else "throw"
    scenario = draw_scenario(name, recipe.effects, rng)
    if recipe.spin_measured is not None:
        scenario = replace(scenario, spin=recipe.spin_measured)
    # a blow is sought at one time of all clips, whose clocks must then agree
    shifted = bool(rng.random() < 0.3) and not any(kind.kick for kind in kinds)
    launches = [launch(scenario, rng) for _ in range(recipe.clips)]
    times = np.arange(round(SECONDS * FPS) + 1) / FPS
    effects: list[Effect] = []
    for effect in recipe.effects:
        effects.append(scaled_effect(effect, recipe, scenario, launches, times, rng=rng))
    size = recipe.strength / 10 * recipe.noise / 0.002
    if recipe.unlisted_share is not None:
        unit = draw_perturbation(None, recipe.unlisted, 1.0, np.random.default_rng(recipe.seed))
        size = recipe.unlisted_share * size_beside(unit, effects[0], scenario, launches, times)
    perturbation = draw_perturbation(recipe.wrong, recipe.unlisted, size, rng)
    engine = recipe.engine if _can_simulate(recipe, scenario) else "mujoco"
    if not perturbation.is_none or not can_simulate(engine, recipe.effects):
        engine = "events"
    launches += [tuple(replace(b, **state) for b, state in zip(launches[0], own, strict=True)) for own in more]
    clips = []
    for number, bodies in enumerate(launches):
        start = rng.uniform(0, 5) if shifted else 0.0
        hidden = tuple(e for e in effects if effect_kinds()[e.name].recording is None)
        motion = ENGINES[engine](Scene(bodies, effects=hidden), times, perturbation)
        clip = _Clip(f"clip_{number:02d}", motion, times + start)
        clips += _measured(clip, scenario, effects, recipe, rng)
    truth = {
        "effects": [{"name": e.name, **{k: _plain(v) for k, v in e.parameters}} for e in effects],
        "unlisted": recipe.unlisted,
        "unlisted_share": recipe.unlisted_share,
        "wrong": recipe.wrong,
        "engine": engine,
        "scenario": scenario.name,
        "strength": recipe.strength,
        "noise": recipe.noise,
        "clips": recipe.clips,
        "seed": recipe.seed,
        "bounces": scenario.name == BOUNCING,
        "damaged": recipe.damaged,
    }
    return World(tuple(clips), known_scene_of(scenario), truth)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _can_simulate(recipe: Recipe, scenario: Scenario) -> bool:
    """Whether the recipe's engine has the effects and the bodies."""
    if recipe.engine == "bullet":
        return can_simulate("bullet", recipe.effects) and scenario.name in ("throw", BOUNCING, "pair")
    if recipe.engine != "events":
        return True
    return can_simulate("events", recipe.effects) and scenario.name not in ("cube", "spin", "carom")


@dataclass(frozen=True)
class _Clip:
    """A clip's name, its motion, and the times (T,) of the motion by the recording's clock, s."""

    name: str
    motion: SimulatedMotion
    times: np.ndarray


def _measured(
    clip: _Clip, scenario: Scenario, effects: list[Effect], recipe: Recipe, rng: np.random.Generator
) -> list[Track]:
    """What a recording of a clip shows, with wrong clocks and lengths, noise, dropouts and outliers."""
    motion, times = clip.motion, clip.times
    tracks = []
    for i, body in enumerate(scenario.bodies):
        shown, position = times, motion.position[:, i].copy()
        for e in effects:
            kind = effect_kinds()[e.name]
            if kind.recording is not None:
                values = {k: np.array(v, float) for k, v in e.parameters}
                shown, position = kind.recording(values, shown, position)
        position += rng.normal(0, recipe.noise, position.shape)
        if recipe.smoothing > 0:
            position = gaussian_filter1d(position, recipe.smoothing, axis=0, mode="nearest")
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
        quaternion, angular_velocity = (None if rows is None else rows[kept] for rows in (turn, spin))
        tracks.append(
            Track(
                clip=clip.name,
                object=body.name,
                time=shown[kept],
                position=position[kept],
                quaternion=quaternion,
                angular_velocity=angular_velocity,
            )
        )
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
