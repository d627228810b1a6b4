"""How models of a mechanism are fitted, and made longer and shorter, for the selection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.discovery.fitting.extension import EQUALS, WORTH_FITTING
from pipeline.discovery.mechanisms.candidate import UNIT, Candidate, Noise, excess_z, noise_of
from pipeline.discovery.mechanisms.kind import MechanismEffect
from pipeline.discovery.mechanisms.law_model import LawModel, with_effect, without_effect
from pipeline.discovery.mechanisms.least_squares import MOST_ITERATIONS, counted, fit, typical_square
from pipeline.discovery.mechanisms.longer_windows import states_of_longer
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.screening import Guess, guesses
from pipeline.discovery.mechanisms.simulation import States
from pipeline.discovery.selection.arc_search import ENOUGH_Z, MOST_FITTED_MORE
from pipeline.discovery.selection.established import HELD_OUT_GAIN
from pipeline.discovery.selection.forward_selection import CLAIM_MORE
from pipeline.discovery.selection.unexplained import UNEXPLAINED_SHARE

FEW_ITERATIONS = 4  # of fits to windows that are not the longest
RACE_ITERATIONS = 3  # after which effects that explain little are given up
STARTS = 2  # guesses of an effect that are fitted, where they promise enough; one of those that take long


@dataclass(frozen=True)
class MechanismSearch:
    """Models of a log that is cut into windows.

    Attributes:
        levels: The log in windows of growing length. Fits begin with short ones, in which every model is near the
            motion, and go on to longer ones, which tell more. Effects race at the first level.
        kinds: The effects that may be named.
        progress: Called with the name of each effect that is fitted.
        noise: Of all scores.
        whole: Variance that the model without effects leaves.
        known: Models that were made longer before, by the effects of the base.
    """

    levels: tuple[Problem, ...]
    kinds: tuple[MechanismEffect, ...]
    progress: Callable[[str], None]
    noise: Noise = UNIT
    whole: float = 0.0
    known: dict[tuple[str, ...], list[Candidate]] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """What models are scored on: the longest windows."""
        return self.levels[-1]

    @property
    def tried(self) -> list[Candidate]:
        """All models that were made longer."""
        return [c for found in self.known.values() for c in found]

    def with_noise(self, noise: Noise, none: Candidate) -> MechanismSearch:
        """The search with other noise. none: the model without effects."""
        return replace(self, noise=noise, whole=none.variance)

    def climb(self, model: LawModel, theta: np.ndarray) -> list[Candidate]:
        """A model fitted at each level, one after the other, as long as it follows the motion.

        Args:
            model: Of the mechanism.
            theta: (G,) where the fit begins.
        """
        first = self.levels[0]
        return self.higher([self._fitted(first, model, theta, first.guessed)])

    def higher(self, climb: Sequence[Candidate]) -> list[Candidate]:
        """A model that was fitted at the first levels, and at the next ones as long as it follows the motion."""
        out = list(climb)
        while len(out) < len(self.levels) and out[-1].follows:
            out.append(self._next(out[-1], self.levels[len(out)]))
        return out

    def at(self, level: int, climb: Sequence[Candidate]) -> Candidate:
        """A model at a level, whether it follows the motion there or not. climb: its fits at the first levels."""
        out = list(climb)
        while len(out) <= level:
            out.append(self._next(out[-1], self.levels[len(out)]))
        return replace(out[level], near=out[0] if level else None)

    def _next(self, before: Candidate, problem: Problem) -> Candidate:
        """A model fitted to the windows of the next level."""
        states = states_of_longer(before.problem, before.fit, problem, problem.guessed)
        return self._fitted(problem, before.fit.model, before.fit.theta, states)

    def _fitted(self, problem: Problem, model: LawModel, theta: np.ndarray, states: States) -> Candidate:
        most = MOST_ITERATIONS if problem is self.problem else FEW_ITERATIONS
        return Candidate(problem, fit(problem, model, theta, states, iterations=most), self.noise)

    def climbs(self, near: Candidate, most: int) -> list[list[Candidate]]:
        """A model with one effect more: those that are worth it, each fitted at each level that it follows.

        Args:
            near: The model at the first level.
            most: Number of effects that are tried.
        """
        more, out = MOST_ITERATIONS - RACE_ITERATIONS, []
        for c in self._raced(near, most):
            f = c.fit
            settled = fit(c.problem, f.model, f.theta, f.states, f.own, iterations=more)
            out.append(self.higher([Candidate(c.problem, settled, self.noise)]))
        return out

    def longer(self, base: Candidate) -> list[Candidate]:
        """`base` with one effect more, the best first."""
        if base.effects not in self.known:
            climbs = self.climbs(base.near or base, MOST_FITTED_MORE)
            last = len(self.levels) - 1
            self.known[base.effects] = [self.at(last, climb) for climb in climbs if len(climb) > last]
        return best_of_each([c for c in (k.rescored(self.noise) for k in self.known[base.effects]) if shows(c, base)])

    def _raced(self, base: Candidate, most: int) -> list[Candidate]:
        """`base` with each promising effect, after a few iterations, if more of them are worth it.

        They are if they would reach the best model, but for noise, were each as good as the last one.
        """
        out = []
        for kind, guess in self._promising(base, most):
            self.progress(kind.name)
            model = with_effect(base.fit.model, kind, guess.places)
            theta = np.concatenate([base.fit.theta, guess.values])
            first = fit(base.problem, model, theta, base.fit.states, base.fit.own, iterations=RACE_ITERATIONS)
            out.append(Candidate(base.problem, first))
        if not out:
            return []
        typical = min(typical_square(c.problem, c.fit.residual) for c in out)
        left = [float(counted(c.fit.residual, typical).sum()) for c in out]
        noise, more = noise_of(out[int(np.argmin(left))]), MOST_ITERATIONS - RACE_ITERATIONS
        enough = min(left) + CLAIM_MORE * noise.variance / noise.information
        return [c for c, own in zip(out, left, strict=True) if own - more * c.fit.falling <= enough]

    def shorter(self, found: Candidate) -> list[Candidate]:
        """`found` without each one of its effects."""
        return [self._without(found, name) for name in found.effects]

    def _without(self, found: Candidate, name: str) -> Candidate:
        model, kept = without_effect(found.fit.model, name)
        again = fit(found.problem, model, found.fit.theta[kept], found.fit.states, found.fit.own)
        near = None if found.near is None else self._without(found.near, name)
        return Candidate(found.problem, again, self.noise, near)

    def rank(self, found: Candidate) -> float:
        """A model's score."""
        return found.score

    def leaves_noise(self, found: Candidate) -> bool:
        """Whether what a model leaves may be noise, or so little beside what it explains that the law itself may be a
        little off: no integrator is exact, and no dry friction quite hard."""
        share = (found.variance - 1) / max(self.whole - 1, 1e-12)
        small = found.near_noise or share <= UNEXPLAINED_SHARE
        return small or excess_z(found, self.noise.information) < ENOUGH_Z

    def holds(self, found: Candidate) -> bool:
        """Whether a model's effects hold without each recording; each has predicted what was not fitted (`shows`)."""
        return bool(found.effects)

    def _promising(self, base: Candidate, most: int) -> list[tuple[MechanismEffect, Guess]]:
        """The effects that promise most, each with the guesses from which it is fitted."""
        kinds = [kind for kind in self.kinds if kind.name not in base.effects]
        noise = noise_of(base)
        price = noise.variance / noise.information * float(np.log(max(base.problem.count * noise.information, 2.0)))
        found = guesses(base.problem, base.fit, kinds, price)
        ranked = sorted((k for k in kinds if k.name in found), key=lambda k: -found[k.name][0].gain)
        enough = WORTH_FITTING * found[ranked[0].name][0].gain if ranked else 0.0
        chosen = ranked[:most] + [k for k in ranked[most : most + EQUALS] if found[k.name][0].gain > enough]
        return [
            (kind, guess)
            for kind in chosen
            for guess in found[kind.name][: 1 if kind.friction else STARTS + (len(found[kind.name][0].places) > 1)]
            if guess is found[kind.name][0] or guess.gain > WORTH_FITTING * found[kind.name][0].gain
        ]


def shows(longer: Candidate, base: Candidate) -> bool:
    """Whether an effect predicts what was not fitted better; also where nothing was held out."""
    return not base.problem.judged or base.held_out - longer.held_out > HELD_OUT_GAIN


def best_of_each(found: Sequence[Candidate]) -> list[Candidate]:
    """Of the models of the same effects the best one, the best first."""
    best: dict[tuple[str, ...], Candidate] = {}
    for c in sorted(found, key=lambda c: c.score):
        best.setdefault(c.effects, c)
    return list(best.values())
