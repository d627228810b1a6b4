"""The discovery: a verdict with its reasons, from a selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate, residuals_m
from pipeline.discovery.fitting.estimates import ParameterEstimate, effect_estimates
from pipeline.discovery.fitting.predictions import FRICTION_PLACE, SCALE_PLACE
from pipeline.discovery.report.augmented_scene import augmented_scene
from pipeline.discovery.report.disagreement import clean_numbers, disagreement, only_with_errors
from pipeline.discovery.report.formula import residual_formula
from pipeline.discovery.report.localisation import Stretch
from pipeline.discovery.report.next_launch import NextLaunch, next_launch
from pipeline.discovery.report.remainder import Remainder, remainder_of
from pipeline.discovery.selection.confidence import SMOOTHED, confidence, probabilities
from pipeline.discovery.selection.equivalence import equivalent_sets, next_experiment
from pipeline.discovery.selection.established import models_without
from pipeline.discovery.selection.gap import Gap, measure_gap
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.tracks.fault import Fault
from pipeline.discovery.tracks.noise import correlation
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.scene import Scene

UNKNOWN = "unknown"
MOST_DISAGREEMENTS = 40
NOTABLE_CORRELATION = 0.1


@dataclass(frozen=True)
class NamedEffect:
    """One effect of a verdict.

    Attributes:
        effect: Its name.
        confidence: Probability that it is there.
        share: Of the explained gap (of its square), that goes back to it; None where the model without it was not
            fitted.
        parameters: By name.
        only: Where it acts, each number with its standard error; None: everywhere.
    """

    effect: str
    confidence: float
    share: float | None
    parameters: dict[str, ParameterEstimate]
    only: dict[str, Any] | None = None


@dataclass(frozen=True)
class Verdict:
    """The answer.

    Attributes:
        effects: Names; empty where nothing is missing; `unknown` alone where no listed effect explains what is missing.
        parameters: By name; as `effect.name` where there are several effects.
        confidence: Probability that the verdict is right.
        equivalent: Sets of effects that the data cannot tell apart.
        experiment: What would tell them apart.
        launch: The most informative next launch; None where the verdict is sure, or no launch helps.
        form: The residual force as a formula, where the effect is unknown.
        named: Each named effect by itself.
        remainder: What the named effects leave unexplained; None where that is noise.
    """

    effects: tuple[str, ...]
    parameters: dict[str, ParameterEstimate]
    confidence: float
    equivalent: tuple[tuple[str, ...], ...]
    experiment: str
    form: str | None = None
    named: tuple[NamedEffect, ...] = ()
    remainder: Remainder | None = None
    launch: NextLaunch | None = None


@dataclass(frozen=True)
class Discovery:
    """Everything that was found.

    Attributes:
        selection: The models that were compared.
        verdict: The answer.
        calibrated: Free parameters of the known scene, without effects.
        gap: Before and after, in metres.
        disagreement: Intervals in which something unknown acts, the most significant first.
        probability: Of `none`, `unknown` and each candidate.
        scene: The known scene with the effects found.
        notes: What a reader should know beside the verdict, a sentence each.
        faults: Of the measurement, those that were mended first.
    """

    selection: Selection
    verdict: Verdict
    calibrated: dict[str, ParameterEstimate]
    gap: Gap
    disagreement: tuple[Stretch, ...]
    probability: dict[str, float]
    scene: Scene
    notes: tuple[str, ...]
    faults: tuple[Fault, ...] = ()

    @property
    def problem(self) -> Problem:
        """What was fitted."""
        return self.selection.problem

    @property
    def answer(self) -> Candidate:
        """The model behind the verdict."""
        return self.selection.answer


def discovery_of(found: Selection, mended: Sequence[Fault] = ()) -> Discovery:
    """The discovery that a selection amounts to. mended: faults that the measurements no longer have."""
    gap = measure_gap(found.measured, found.baseline, found.answer)
    return Discovery(
        selection=found,
        verdict=_verdict(found, gap),
        calibrated=clean_numbers(found),
        gap=gap,
        disagreement=tuple(disagreement(found)[:MOST_DISAGREEMENTS]),
        probability=probabilities(found),
        scene=augmented_scene(found),
        notes=_notes(found),
        faults=(*mended, *_faults_of_noise(found)),
    )


def _faults_of_noise(found: Selection) -> list[Fault]:
    """Outliers, which were left out, and correlated noise, which counts as fewer samples.

    The noise is what the answer leaves, too: polynomials alone also leave what they do not follow.
    """
    problem = found.problem
    out = [Fault("outliers", problem.outliers, "samples")] if problem.outliers else []
    if problem.floor.correlation > NOTABLE_CORRELATION:
        answer = found.answer
        left = zip(answer.problem.stacks, residuals_m(answer.problem, answer), strict=True)
        rows = [r[w.max(1) > 0] for stack, own in left for w, r in zip(stack.weight, own, strict=True)]
        size = min(problem.floor.correlation, correlation(rows, answer.parameters))
        if size > NOTABLE_CORRELATION:
            out.append(Fault("correlated_noise", size, "-"))
    return out


def _verdict(found: Selection, gap: Gap) -> Verdict:
    answer = found.answer
    names = (UNKNOWN,) if found.unknown else answer.effects
    equivalent = equivalent_sets(found)
    own = {name: effect_estimates(answer, name) for name in answer.effects}
    several = len(own) > 1
    sure, shares = confidence(found, names), _shares(found)
    experiment, launch = next_experiment(names, equivalent), next_launch(found, sure)
    return Verdict(
        effects=names,
        parameters={f"{n}.{k}" if several else k: e for n, numbers in own.items() for k, e in numbers.items()},
        confidence=sure,
        equivalent=equivalent,
        experiment=experiment if launch is None else f"{launch.sentence}; {experiment}",
        form=residual_formula(found.none) if found.unknown else None,
        named=tuple(
            NamedEffect(name, sure, shares.get(name), numbers, only_with_errors(answer, name))
            for name, numbers in own.items()
        ),
        remainder=remainder_of(found, gap),
        launch=launch,
    )


def _shares(found: Selection) -> dict[str, float]:
    """Each named effect's share of the explained chi squared, by the models without it."""
    lost = {n: without.position_chi2 - found.chosen.position_chi2 for n, without in models_without(found).items()}
    whole = sum(max(v, 0.0) for v in lost.values())
    return {n: max(v, 0.0) / whole for n, v in lost.items()} if whole else {}


def _notes(found: Selection) -> tuple[str, ...]:
    problem, notes = found.problem, []
    if not problem.held_out:
        notes.append("there is only one clip: the gap is measured on the clip that was fitted")
    scatter = _scatter(found.answer, SCALE_PLACE)
    if scatter > 0:
        notes.append(
            f"the length scales of the clips seem to differ, by {scatter:.1%}: each clip was fitted with one of its own"
        )
    friction = _scatter(found.answer, FRICTION_PLACE)
    if friction > 0:
        notes.append(
            f"the sliding friction of single slides seems to differ, by {friction:.1%}: each was fitted with its own"
        )
    spin = _unmeasured_spin(found.answer)
    if spin > 0:
        notes.append(
            f"spins were not measured: each flight was fitted with one of its own ({spin:.3g} rad/s, root mean square, "
            "for the lift coefficient of a ball in air); only the product of spin and coefficient is determined"
        )
    if problem.floor.correlation > NOTABLE_CORRELATION:
        notes.append(
            f"the noise is correlated (by {problem.floor.correlation:.2f} between neighbouring samples): "
            f"a sample counts as {problem.floor.information:.2f} independent samples"
        )
    smoothing = problem.floor.smoothing
    if smoothing.width:
        notes.append(
            f"positions were smoothed, as if by a Gaussian filter of {smoothing.width:.2g} samples: a sample counts as "
            f"{smoothing.information:.2f} independent samples, and those within {smoothing.reach:.2g} s of an impact "
            "or of an end of a recording were left out"
        )
    if problem.sigma < SMOOTHED:
        notes.append(
            f"positions scatter by only {1e3 * problem.sigma:.2g} mm, so they were smoothed: residuals may be "
            "artefacts of the smoothing"
        )
    if problem.outliers:
        notes.append(f"{problem.outliers} samples were left out as outliers")
    if problem.dropped:
        notes.append(f"{problem.dropped} arcs were left out: the model that explains all others does not explain them")
    if problem.jumps:
        notes.append(f"{problem.jumps} velocity jumps are no impact with the ground or a known object")
    if found.untestable:
        notes.append("not testable with these measurements: " + ", ".join(found.untestable))
    return tuple(notes)


def _unmeasured_spin(answer: Candidate) -> float:
    """Root mean square of the sizes of the spins that were fitted to flights, rad/s; 0 where there are none."""
    own = [
        start[stack.unmeasured_spin & (stack.samples > 0), 6:9]
        for stack, start in zip(answer.problem.stacks, answer.fit.starts, strict=True)
        if stack.spin_sigma
    ]
    return float(np.sqrt((np.concatenate(own) ** 2).sum(1).mean())) if own else 0.0


def _scatter(answer: Candidate, place: int) -> float:
    """Root mean square of a relative error of the arcs' own, 0 where they have none. place: in their initial states."""
    own = [
        start[(stack.samples > 0) & (stack.slides | (place == SCALE_PLACE)), place]
        for stack, start in zip(answer.problem.stacks, answer.fit.starts, strict=True)
        if (stack.length_scale_sigma if place == SCALE_PLACE else stack.friction_sigma)
    ]
    return float(np.sqrt(np.mean(np.concatenate(own) ** 2))) if own else 0.0
