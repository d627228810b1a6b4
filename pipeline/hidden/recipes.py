"""Which worlds are made: the recipe of each of a list of worlds, in turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.hidden.engine import EVENT_EFFECTS
from pipeline.hidden.world import UNLISTED, WRONG_LAWS, Recipe

NONE, UNKNOWN = "none", "unlisted"
WRONG_OF = {"air_drag": "drag_slope", "magnus_lift": "spin_decay"}
assert set(WRONG_OF.values()) == set(WRONG_LAWS)


def recipe_of(
    number: int, effects: Sequence[str], strength: float, noise: float, clips: int, rng: np.random.Generator
) -> Recipe:
    """World `number` of a list that goes round `effects`: names, `a+b` for two, `none`, or `unlisted` for a law in
    no list.

    Every other world is made without MuJoCo where it can be; a third is damaged by dropouts and outliers; a quarter of
    those of `WRONG_OF` have their law slightly wrong.
    """
    name = effects[number % len(effects)]
    engine = "events" if rng.random() < 0.5 else "mujoco"
    bounces, damaged = bool(rng.random() < 0.4), bool(rng.random() < 1 / 3)
    seed = int(rng.integers(2**31))
    if name == UNKNOWN:
        return Recipe(seed, (), strength, noise, clips, False, damaged, "events", unlisted=str(rng.choice(UNLISTED)))
    hidden = () if name == NONE else tuple(name.split("+"))
    wrong = WRONG_OF.get(name) if rng.random() < 0.25 else None
    if not set(hidden) <= set(EVENT_EFFECTS):
        engine = "mujoco"
    return Recipe(seed, hidden, strength, noise, clips, bounces and wrong is None, damaged, engine, wrong)
