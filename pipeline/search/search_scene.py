"""The search for the scene of a clip, from bodies registered to its outlines and from the model's answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import rank
from pipeline.search.composition import best_mixture, propose_compositions
from pipeline.search.evaluator import Evaluator
from pipeline.search.fit_scene import RUN_SIMULATIONS, fit_scene
from pipeline.search.outlines.shape_evidence import LEAST_PROBABILITY, ShapeEvidence
from pipeline.search.parameters import rollable
from pipeline.search.search_result import SearchRecord, SearchResult


@dataclass(frozen=True)
class SceneSearch:
    """The result of a search, and its classical guess.

    Attributes:
        result: The best scene.
        guess: The scene that was registered to the outlines; None where the target has no instances.
        guess_simulations: Simulations that the guess took.
        shapes: For each instance the probability of each basic shape.
    """

    result: SearchResult
    guess: Scene | None
    guess_simulations: int
    shapes: tuple[dict[str, float], ...]


def search_scene(
    evaluator: Evaluator,
    answers: Sequence[Scene],
    simulations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda spent, reward: None,
    incline: bool = False,
) -> SceneSearch:
    """Search for the scene of the evaluator's target.

    Args:
        evaluator: Evaluates candidates.
        answers: Scenes to start from.
        simulations: The budget.
        rng: Random generator.
        progress: Called with the simulations spent and the best reward so far.
        incline: The ground may be inclined: the camera may roll, and gravity need not be normal to the ground.
    """
    record = SearchRecord(evaluator)
    room = max(1, simulations // RUN_SIMULATIONS)
    proposal = propose_compositions(evaluator.outlines, evaluator.target, evaluator.times, room)
    own = [best_mixture(evaluator, scenes) for scenes in proposal.starts if scenes[0].objects]
    guessing = record.simulations
    agreeing = [a for a in answers if agrees(evaluator, a, proposal.evidence)] if own else list(answers)
    starts = [*own[:1], *agreeing, *own[1:]]
    if incline:
        starts = [replace(s, camera=rollable(s.camera)) if s.camera else s for s in starts]
    order = rank(evaluator, starts).order
    result = fit_scene(evaluator, record, [starts[i] for i in order], simulations, rng, progress)
    shapes = tuple(dict(e.probability) for e in proposal.evidence)
    return SceneSearch(result, own[0] if own else None, guessing, shapes)


def agrees(evaluator: Evaluator, scene: Scene, evidence: Sequence[ShapeEvidence]) -> bool:
    """Whether a scene has an object for each instance, of a shape that its outlines allow."""
    if len(scene.objects) != len(evidence):
        return False
    for i, j in evaluator.pairs(scene):
        probability = evidence[j].probability
        if probability.get(scene.shapes[i], 0.0) < LEAST_PROBABILITY * max(probability.values()):
            return False
    return True
