"""Discovery as a whole: from tracks and a known scene to a verdict with its reasons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.discrepancy.candidate import Candidate
from pipeline.discrepancy.confidence import SMOOTHED, confidence, probabilities
from pipeline.discrepancy.equivalence import alike_sets, experiment
from pipeline.discrepancy.estimate import Estimate, calibrated, effect_estimates
from pipeline.discrepancy.formula import residual_formula
from pipeline.discrepancy.gap import Gap, measure_gap, residuals_m
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.localise import Stretch, direction_words, stretches
from pipeline.discrepancy.noise import correlation
from pipeline.discrepancy.problem import Problem, blunted, pose, with_rulers
from pipeline.discrepancy.select import CLAIM_MORE, LEAST_CLIPS_FOR_MORE, UNEXPLAINED_Z, Selection, Selector
from pipeline.discrepancy.track import Track
from pipeline.scene.scene import Effect, Scene

UNKNOWN = "unknown"
MOST_DISAGREEMENTS = 40
NOTABLE_Z = 3.0


@dataclass(frozen=True)
class Verdict:
    """effects: names, empty where nothing is missing, `unknown` alone where something is and no effect explains it.
    parameters: by name, `effect.name` where there are several effects. equivalent: sets that the data cannot tell
    apart; experiment: what would. form: the residual force as a formula, of an unknown effect."""

    effects: tuple[str, ...]
    parameters: dict[str, Estimate]
    confidence: float
    equivalent: tuple[tuple[str, ...], ...]
    experiment: str
    form: str | None = None


@dataclass(frozen=True)
class Discovery:
    """Everything that was found. answer: the model behind the verdict, the calibrated one where it names no effect;
    baseline: the calibrated model with lengths as they are said to be."""

    problem: Problem
    selection: Selection
    verdict: Verdict
    answer: Candidate
    calibrated: dict[str, Estimate]
    gap: Gap
    disagreement: tuple[Stretch, ...]
    probability: dict[str, float]
    scene: Scene
    notes: tuple[str, ...]
    baseline: Candidate


def discover(
    tracks: Sequence[Track], known: KnownScene, held_out: float, effects: Sequence[str], rng: np.random.Generator,
    progress: Callable[[str], None] = lambda _: None,
) -> Discovery:  # fmt: skip
    """Find out which of `effects` the measurements ask for. rng: chooses the clips that are held out.

    Raises `MeasurementError` for tracks that do not fit the scene or hold nothing to be fitted.
    """
    selector, found, plain = _asked(pose(tracks, known, held_out, rng), effects, progress)
    problem = selector.problem
    answer = found.none if found.unknown else found.chosen
    numbers = calibrated(selector, found.none)
    equivalent = alike_sets(found, problem, numbers, selector)
    names = (UNKNOWN,) if found.unknown else found.chosen.effects
    parameters: dict[str, Estimate] = {}
    for name in answer.effects:
        for key, estimate in effect_estimates(answer, name).items():
            parameters[key if len(answer.effects) == 1 else f"{name}.{key}"] = estimate
    verdict = Verdict(
        names, parameters, confidence(found, names), equivalent, experiment(names, equivalent),
        residual_formula(problem, found.none) if found.unknown else None,
    )  # fmt: skip
    gap = measure_gap(problem, plain, answer)
    where = [s for s in stretches(problem, found.none) if s.z > NOTABLE_Z][:MOST_DISAGREEMENTS]
    scene = augmented_scene(known, answer, calibrated(selector, answer), problem)
    notes = notes_of(problem, found, answer)
    return Discovery(problem, found, verdict, answer, numbers, gap, tuple(where), probabilities(found), scene, notes,
                     plain)  # fmt: skip


def _asked(
    problem: Problem, effects: Sequence[str], progress: Callable[[str], None]
) -> tuple[Selector, Selection, Candidate]:  # fmt: skip
    """The selection; where it leaves more of several clips than noise, that in which each has a length scale of its
    own, if that explains them. Of two or three clips, whose tracking may be off slowly and each in its way, what even
    that leaves is taken for noise. And the calibrated model with the lengths as they are said to be."""
    selector = Selector(problem, effects, progress)
    found = selector.select()
    if found.excess_z > UNEXPLAINED_Z and len(problem.fitted) + len(problem.held_out) > 1:
        other = Selector(with_rulers(problem), effects, progress)
        again = other.select()
        if len(problem.fitted) < LEAST_CLIPS_FOR_MORE and again.excess_z > UNEXPLAINED_Z:
            other = Selector(blunted(other.problem, independent_share(again.chosen)), effects, progress)
            return other, other.select(), found.none
        if not again.unknown and again.chosen.score < found.chosen.score - CLAIM_MORE:
            return other, again, found.none
    return selector, found, found.none


def independent_share(found: Candidate) -> float:
    """What a sample is worth, of one with the noise alone, where all that a model leaves is correlated noise."""
    problem = found.problem
    rows = []
    for stack, left in zip(problem.stacks, residuals_m(problem, found), strict=True):
        scaled = left * stack.weight
        there = stack.weight.max(2) > 0
        rows += [scaled[i, there[i]] for i in range(len(stack)) if there[i].any()]
    variance = sum(float((r * r).sum()) for r in rows) / max(problem.rows - problem.own, 1)
    r = correlation(rows, problem.own)
    return float(np.clip((1 - r) / (1 + r) / max(variance, 1.0), 1e-3, 1.0))


def ruler_scatter(problem: Problem, answer: Candidate) -> float:
    """Root mean square of the arcs' own length scales, relative; 0 where they have none."""
    own = [s[stack.samples > 0, 9] for stack, s in zip(problem.stacks, answer.fit.starts, strict=True) if stack.ruler]
    return float(np.sqrt(np.mean(np.concatenate(own) ** 2))) if own else 0.0


def augmented_scene(known: KnownScene, answer: Candidate, numbers: dict[str, Estimate], problem: Problem) -> Scene:
    """The scene with the effects found, numbers as calibrated with them, and the motion of the first clip."""
    objects = []
    for number, obj in enumerate(known.scene.objects):
        for key in ("sliding_friction", "rolling_friction", "damping"):
            estimate = numbers.get(f"{obj.name}.{key}")
            if estimate is not None and estimate.stderr is not None:
                assert isinstance(estimate.value, float)
                changed: dict[str, Any] = {key: max(estimate.value, 1e-3 if key == "damping" else 0.0)}
                obj = replace(obj, **changed)
        arcs = [a for a in problem.arcs if a.object == number]
        if arcs:
            first = min(arcs, key=lambda a: (a.clip != problem.arcs[0].clip, a.time[0]))
            index = problem.arcs.index(first) if first in problem.arcs else -1
            obj = _started(obj, answer, index, first.quaternion)
        objects.append(obj)
    effects = [*known.scene.effects]
    for name in answer.effects:
        values = {k: e.value for k, e in effect_estimates(answer, name).items()}
        effects.append(Effect(name, tuple((k, tuple(v) if isinstance(v, list) else v) for k, v in values.items())))
    gravity = known.scene.gravity
    if "gravity" in numbers:
        gravity = tuple(np.array(gravity) / np.linalg.norm(gravity) * numbers["gravity"].value)
    return replace(known.scene, objects=tuple(objects), effects=tuple(effects), gravity=gravity)


def _started(obj: Any, answer: Candidate, index: int, quaternion: np.ndarray | None) -> Any:
    for stack, start in zip(answer.problem.stacks, answer.fit.starts, strict=True):
        place = np.flatnonzero(stack.index == index)
        if len(place):
            s = start[place[0]]
            turn = obj.orientation if quaternion is None else tuple(quaternion[0])
            return replace(
                obj, position=tuple(s[:3]), velocity=tuple(s[3:6]), angular_velocity=tuple(s[6:9]), orientation=turn
            )
    return obj


def notes_of(problem: Problem, found: Selection, answer: Candidate) -> tuple[str, ...]:
    """What a reader should know beside the verdict, a sentence each."""
    notes = []
    if not problem.held_out:
        notes.append("there is only one clip: the gap is measured on the clip that was fitted")
    scatter = ruler_scatter(problem, answer)
    if scatter > 0:
        notes.append(
            f"the clips differ from each other as if their rulers did, by {scatter:.1%}: taken as a nuisance of each"
        )
    if problem.floor.correlation > 0.1:
        notes.append(
            f"the noise is not white (neighbouring samples correlate by {problem.floor.correlation:.2f}): "
            f"a sample counts as {problem.floor.information:.2f} independent ones"
        )
    if problem.sigma < SMOOTHED:
        notes.append(
            f"positions scatter by {1e3 * problem.sigma:.2g} mm only: they were smoothed, and what is left may be the "
            "smoothing's"
        )
    if problem.outliers:
        notes.append(f"{problem.outliers} samples were left out as outliers")
    if problem.broken:
        notes.append(f"{problem.broken} stretches were left out: the model that explains all others misses them by far")
    if problem.jumps:
        notes.append(f"velocity jumps {problem.jumps} times where nothing known is hit")
    if found.untestable:
        notes.append("not testable with these measurements: " + ", ".join(found.untestable))
    return tuple(notes)


def report(found: Discovery) -> dict[str, Any]:
    """The discovery as the content of report.json (docs/formats.md, "Discovery")."""
    v, selection, names = found.verdict, found.selection, [o.name for o in found.problem.known.scene.objects]
    candidates: list[dict[str, Any]] = []
    shown = {c.effects: c for c in (*selection.singles, *([selection.chosen] if selection.chosen.effects else []))}
    for effects, c in shown.items():
        several = len(effects) > 1
        parameters = {
            (f"{e}.{k}" if several else k): x.as_dict() for e in effects for k, x in effect_estimates(c, e).items()
        }
        candidates.append({
            "effect": "+".join(effects), "probability": found.probability["+".join(effects)],
            "delta_bic": c.bic - selection.none.bic, "held_out_gain": (selection.none.held_out - c.held_out) / 2,
            "parameters": parameters,
        })  # fmt: skip
    candidates.sort(key=lambda c: -c["probability"])
    verdict: dict[str, Any] = {
        "effects": list(v.effects),
        "parameters": {k: e.as_dict() for k, e in v.parameters.items()},
        "confidence": v.confidence,
        "equivalent": [list(s) for s in v.equivalent],
        "experiment": v.experiment,
    }
    if v.form is not None:
        verdict["form"] = v.form
    return {
        "noise": {"position_m": found.problem.sigma, "orientation_rad": orientation_noise(found.problem)},
        "clips": {"fitted": list(found.problem.fitted), "held_out": list(found.problem.held_out)},
        "calibrated": {k: e.as_dict() for k, e in found.calibrated.items()},
        "disagreement": [
            {"clip": s.clip, "object": names[s.object], "t_start": s.start, "t_end": s.end, "regime": str(s.regime),
             "residual": float(np.linalg.norm(s.force)), "unit": "N", "z_score": s.z, "direction": direction_words(s)}
            for s in found.disagreement
        ],
        "candidates": candidates,
        "verdict": verdict,
        "gap": {"metric": "position_rmse_m", "before": found.gap.before, "after": found.gap.after,
                "noise_floor": found.gap.noise_floor, "clips": list(found.gap.clips)},
        "probability_of_none": found.probability["none"],
        "unexplained": {"share": selection.excess_share, "z_score": selection.excess_z},
        "impacts": [
            {"clip": b.clip, "object": names[b.object], "time": b.time, "restitution": b.restitution, "stderr": b.sigma}
            for b in selection.bounces
        ],
        "notes": list(found.notes),
    }  # fmt: skip


def orientation_noise(problem: Problem) -> float | None:
    """Standard deviation of measured orientations, rad, from second differences of quaternions; None without any."""
    values = []
    for arc in problem.arcs:
        if arc.quaternion is not None and len(arc.quaternion) > 8:
            q = arc.quaternion * np.sign((arc.quaternion * arc.quaternion[:1]).sum(1, keepdims=True) + 1e-12)
            fourth = np.diff(q, n=4, axis=0)
            values.append(2 * 1.4826 * np.median(np.abs(fourth)) / np.sqrt(70))
    return float(np.median(values)) if values else None
