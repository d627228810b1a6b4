"""Scenes to start from: the most probable shapes of the instances, registered to their outlines.

No simulation is needed, so the shapes of several bodies do not compete for the search's budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.physics.batch import stack_scenes
from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.guess import guess_object, guess_scene, track_mask
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.outlines.registered_scene import registered_scenes
from pipeline.search.outlines.shape_evidence import LEAST_PROBABILITY, ShapeEvidence, joint_probabilities
from pipeline.search.target import Target
from pipeline.vision.rendering.camera import pinhole


@dataclass(frozen=True)
class Proposal:
    """Scenes whose object i is instance i.

    Attributes:
        starts: For each composition, the most probable first, scenes that differ in what outlines do not tell.
        evidence: Of each instance.
    """

    starts: tuple[list[Scene], ...]
    evidence: tuple[ShapeEvidence, ...]


def propose_compositions(outlines: ClipOutlines, target: Target, target_times: np.ndarray, most: int) -> Proposal:
    """Scenes with the most probable shapes of the instances.

    Args:
        outlines: Of the clip.
        target: Of the search, for instances without outlines.
        target_times: (F,) of the target's frames, s.
        most: Largest number of scenes.
    """
    evidence = outlines.evidence
    likely = joint_probabilities(evidence, most)
    starts = [
        _scenes(shapes, evidence, outlines, target, target_times)
        for shapes, probability in likely
        if probability >= LEAST_PROBABILITY * likely[0][1]
    ]
    return Proposal(tuple(starts), evidence)


def _scenes(
    shapes: Sequence[str],
    evidence: Sequence[ShapeEvidence],
    outlines: ClipOutlines,
    target: Target,
    target_times: np.ndarray,
) -> list[Scene]:
    """Scenes of registered instances, and of guesses for those without an outline."""
    known = [i for i, e in enumerate(evidence) if e.registrations]
    if not known:
        return [guess_scene(target, shapes, target_times)]
    scenes = registered_scenes([evidence[i].registrations[shapes[i]] for i in known], outlines.height)
    assert scenes[0].camera is not None
    view = pinhole(scenes[0].camera)
    others = {
        i: guess_object(shape, track_mask(target.masks, i), target, target_times, view)
        for i, shape in enumerate(shapes)
        if i not in known
    }
    return [
        replace(s, objects=tuple(others[i] if i in others else s.objects[known.index(i)] for i in range(len(shapes))))
        for s in scenes
    ]


def best_mixture(evaluator: Evaluator, scenes: Sequence[Scene]) -> Scene:
    """The scene that has each object from the scene, of those with one gravity, in which it costs least.

    Args:
        evaluator: Evaluates candidates.
        scenes: Of one composition, whose object i is instance i.
    """
    pairs = np.stack([np.arange(len(scenes[0].objects))] * 2, 1)
    residuals, _ = evaluator.residuals(stack_scenes(list(scenes)), pairs)
    mixtures, costs = [], []
    for gravity in dict.fromkeys(s.gravity for s in scenes):
        rows = [b for b, s in enumerate(scenes) if s.gravity == gravity]
        best = residuals.cost[rows].argmin(0)
        mixtures.append(replace(scenes[rows[0]], objects=tuple(scenes[rows[k]].objects[i] for i, k in enumerate(best))))
        costs.append(residuals.cost[rows].min(0).sum())
    return mixtures[int(np.argmin(costs))]
