"""Scenes to start from: the most probable shapes of the instances, registered to their outlines.

No simulation is needed, so the shapes of several bodies do not compete for the search's budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.physics.overlap import separated
from pipeline.scene.scene import Scene
from pipeline.search.guess import guess_object, guess_scene, track_mask
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.outlines.registered_scene import registered_scene
from pipeline.search.outlines.shape_evidence import LEAST_PROBABILITY, ShapeEvidence, joint_probabilities
from pipeline.search.target import Target
from pipeline.vision.rendering.camera import pinhole


@dataclass(frozen=True)
class Proposal:
    """Scenes whose object i is instance i.

    Attributes:
        scenes: The most probable shapes first.
        evidence: Of each instance.
    """

    scenes: tuple[Scene, ...]
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
    scenes = [
        _scene(shapes, evidence, outlines, target, target_times)
        for shapes, probability in likely
        if probability >= LEAST_PROBABILITY * likely[0][1]
    ]
    return Proposal(tuple(scenes), evidence)


def _scene(
    shapes: Sequence[str],
    evidence: Sequence[ShapeEvidence],
    outlines: ClipOutlines,
    target: Target,
    target_times: np.ndarray,
) -> Scene:
    """The scene of registered instances, and of guesses for those without an outline."""
    known = [i for i, e in enumerate(evidence) if e.registrations]
    if not known:
        return guess_scene(target, shapes, target_times)
    found = registered_scene([evidence[i].registrations[shapes[i]] for i in known], outlines.times, outlines.height)
    assert found.camera is not None
    view = pinhole(found.camera)
    objects = [
        found.objects[known.index(i)]
        if i in known
        else guess_object(shape, track_mask(target.masks, i), target, target_times, view)
        for i, shape in enumerate(shapes)
    ]
    return separated(replace(found, objects=tuple(objects)))
