"""The known scene with the effects found, so that it moves as the measured one did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import ParameterEstimate, calibrated, estimates_by_body
from pipeline.discovery.selection.local_effect import only_of
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.known_scene import FITTED
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.scene import Effect, Scene, SceneObject

LEAST_DAMPING = 1e-3


def augmented_scene(found: Selection) -> Scene:
    """The scene with the answer's effects, parameters as calibrated with them, and the motion of the first clip."""
    answer, problem = found.answer, found.problem
    scene = scene_of(found, answer)
    objects = []
    for number, obj in enumerate(scene.objects):
        first = first_arc(problem, number)
        objects.append(obj if first is None else _with_motion(obj, answer, *first))
    return replace(scene, objects=tuple(objects))


def first_arc(problem: Problem, number: int) -> tuple[int, Arc] | None:
    """Index and arc of an object's first motion: in the first clip, else the earliest; None where it has none."""
    arcs = [(i, a) for i, a in enumerate(problem.arcs) if a.object == number]
    return min(arcs, key=lambda pair: (pair[1].clip != problem.arcs[0].clip, pair[1].time[0]), default=None)


def scene_of(found: Selection, model: Candidate) -> Scene:
    """The known scene with a model's effects and its calibrated parameters, without the motion of a clip."""
    scene = found.problem.known.scene
    numbers = calibrated(found.calibration, model)
    objects = [_with_parameters(obj, numbers) for obj in scene.objects]
    effects = [*scene.effects]
    for name in model.effects:
        for body, estimates in estimates_by_body(model, name).items():
            values = tuple((k, tuple(e.value) if isinstance(e.value, list) else e.value) for k, e in estimates.items())
            objects_ = None if body is None else (scene.objects[body].name,)
            effects.append(Effect(name, values, objects_, only_of(model, name)))
    gravity = scene.gravity
    if "gravity" in numbers:
        gravity = tuple(np.array(gravity) / np.linalg.norm(gravity) * numbers["gravity"].value)
    return replace(scene, objects=tuple(objects), effects=tuple(effects), gravity=gravity)


def _with_parameters(obj: SceneObject, numbers: Mapping[str, ParameterEstimate]) -> SceneObject:
    """The object with its determined contact numbers."""
    for key in FITTED:
        estimate = numbers.get(f"{obj.name}.{key}")
        if estimate is not None and estimate.stderr is not None:
            assert isinstance(estimate.value, float)
            changed: dict[str, Any] = {key: max(estimate.value, LEAST_DAMPING if key == "damping" else 0.0)}
            obj = replace(obj, **changed)
    return obj


def _with_motion(obj: SceneObject, answer: Candidate, index: int, arc: Arc) -> SceneObject:
    """The object with the fitted initial state of an arc, where the answer has it. index: of the arc."""
    for stack, start in zip(answer.problem.stacks, answer.fit.starts, strict=True):
        place = np.flatnonzero(stack.index == index)
        if len(place):
            s = start[place[0]]
            return replace(
                obj,
                position=tuple(s[:3]),
                velocity=tuple(s[3:6]),
                angular_velocity=tuple(s[6:9]),
                orientation=obj.orientation if arc.quaternion is None else tuple(arc.quaternion[0]),
            )
    return obj
