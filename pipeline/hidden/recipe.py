"""The recipe of a hidden world, and that of each of a list of worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.hidden.engine import can_simulate
from pipeline.hidden.law_perturbation import UNLISTED
from pipeline.scene.effects.registry import effect_kinds

NONE, UNKNOWN = "none", "unlisted"


@dataclass(frozen=True)
class Recipe:
    """What a world is made of.

    Attributes:
        seed: A label.
        effects: Hidden names.
        strength: In detection limits.
        noise: Standard deviation of each coordinate, m.
        clips: How many.
        bounces: Whether balls hit the ground.
        damaged: Whether there are dropouts and outliers.
        engine: The preferred one, of `ENGINES`.
        wrong: How the law is perturbed, of `WRONG_LAWS`.
        unlisted: A law that is no effect, of `UNLISTED`.
        unlisted_share: How far that law moves bodies, over how far the first hidden effect does; without one it is as
            strong as an effect of the recipe's strength would be.
        spin_measured: Whether spins are measured; None: where the effects need it, else in half of the worlds.
        smoothing: Standard deviation of a Gaussian filter of the positions, in samples; 0: they are as measured.
    """

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
    unlisted_share: float | None = None
    spin_measured: bool | None = None
    smoothing: float = 0.0


def perturbed_kinds() -> dict[str, str]:
    """Name -> how its law may be perturbed, of the effects whose law may be."""
    hiding = {name: kind.hiding for name, kind in effect_kinds().items()}
    return {name: h.wrong_law for name, h in hiding.items() if h is not None and h.wrong_law is not None}


def recipe_of(
    number: int, effects: Sequence[str], strength: float, noise: float, clips: int, *, rng: np.random.Generator
) -> Recipe:
    """The recipe of one world of a list that cycles through `effects`.

    Half of the worlds are made without MuJoCo where that is possible; a third is damaged by dropouts and outliers; a
    quarter of those whose law may be perturbed have it slightly wrong.

    Args:
        number: Of the world.
        effects: Names; `a+b` for two; `none`; or `unlisted` for a law in no list.
        strength: In detection limits.
        noise: Standard deviation of each coordinate, m.
        clips: How many.
        rng: Draws the rest.
    """
    name = effects[number % len(effects)]
    engine = "events" if rng.random() < 0.5 else "mujoco"
    bounces, damaged = bool(rng.random() < 0.4), bool(rng.random() < 1 / 3)
    seed = int(rng.integers(2**31))
    unlisted = str(rng.choice(UNLISTED)) if name == UNKNOWN else None
    if unlisted is not None:
        return Recipe(
            seed, (), strength, noise, clips, bounces=False, damaged=damaged, engine="events", unlisted=unlisted
        )
    hidden = () if name == NONE else tuple(name.split("+"))
    wrong = perturbed_kinds().get(name) if rng.random() < 0.25 else None
    if not can_simulate("events", hidden):
        engine = "mujoco"
    bounces = bounces and wrong is None
    return Recipe(seed, hidden, strength, noise, clips, bounces=bounces, damaged=damaged, engine=engine, wrong=wrong)
