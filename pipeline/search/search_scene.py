"""A clip's search from everything at hand: the model's answers, and a classical guess."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import rank
from pipeline.search.composition import compose
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit_scene import ISLAND, fit
from pipeline.search.guess import CAMERA
from pipeline.search.parameters import rollable
from pipeline.search.search_result import Found, Record

COMPOSING = 1800  # simulations, from which a search has enough left after a guess has found its shapes


@dataclass(frozen=True)
class Solved:
    """What the search found; guess: the classical guess, None where the budget or the target has no room for one, and
    how many of the simulations it took."""

    found: Found
    guess: Scene | None
    guess_simulations: int


def solve(
    evaluator: Evaluator,
    answers: Sequence[Scene],
    simulations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda spent, reward: None,
    incline: bool = False,
) -> Solved:
    """The best scene for the evaluator's target found with so many simulations, from the answers and the guess.

    incline: the ground may slope in the picture: the camera may roll, and gravity need not be normal to the ground.
    """
    record, guesses, guessing = Record(evaluator), [], 0
    starts = [replace(a, camera=rollable(a.camera)) if incline and a.camera else a for a in answers]
    if evaluator.target.instances and (simulations >= COMPOSING or not starts):
        room = max(1, simulations // ISLAND - len(answers))
        guesses = compose(evaluator, record, simulations, rng, rollable(CAMERA) if incline else CAMERA, room)
        guessing = record.simulations
        progress(record.simulations, record.reward)
        starts.append(guesses[0])
    order = rank(evaluator, starts).order
    found = fit(evaluator, record, [*(starts[i] for i in order), *guesses[1:]], simulations, rng, progress)
    return Solved(found, guesses[0] if guesses else None, guessing)
