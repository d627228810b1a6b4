"""Models of one problem, fitted and scored.

Every model, from none to three effects, gets one score, in the units of chi squared: what it leaves of the fitted
clips, plus BIC's price of its parameters, plus what it leaves of the held-out clips. Of the effects that could be
added to a model, those are fitted that the quick regression finds promising.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.candidate import Candidate, with_obstacle
from pipeline.discrepancy.fit import MOST_ITERATIONS, fit, unstuck
from pipeline.discrepancy.impact import bounces, fit_restitution
from pipeline.discrepancy.model import Model, known_model, with_effect, without_effect
from pipeline.discrepancy.obstacle import fit_obstacle
from pipeline.discrepancy.problem import Problem, split_at_jumps, starts_of
from pipeline.discrepancy.quick import Guess, QuickRegression
from pipeline.discrepancy.starts import starts
from pipeline.scene.effects.kind import EffectKind

CLAIM = 8.0  # by how much a first effect must win; frozen on development worlds (benchmarks/discovery.py)
WORTH_FITTING = 0.5  # share of the best quick gain that makes a further fit worth while
BEGINNINGS, MANY_BEGINNINGS = 2, 5  # starts of an effect that are fitted; of one that acts by the place
SHUFFLED_SHARE = 0.5  # of the gain with a measured spin, that the spin of other clips may reach
OBSTACLE_MISFIT = 0.1  # m; friction of a hit turns its direction
FRICTIONS = (0.5, 0.2, 0.07)  # sliding friction, with which calibration begins
SHARPER = 0.9  # of the noise's variance as polynomials have it: what the best model must leave less than
EQUALS = 5  # further effects that are fitted because they promise nearly as much as the best
MOST_FITTED = 9  # effects that are fitted at a time, the most promising by the quick regression


class Fitter:
    """Fits models of one problem with effects of some kinds.

    bounces: what the calibrated model makes of the impacts; restitution: a factor of their own for them, None where
    they tell nothing. sharper: by how much the noise is smaller than polynomials have it. none: the calibrated model
    without effects.
    """

    def __init__(self, problem: Problem, kinds: Sequence[EffectKind], progress: Callable[[str], None]) -> None:
        self.problem, self.known, self.kinds, self.progress = problem, problem.known, kinds, progress
        self.sharper = 1.0
        self.restitution = None
        calibrated = self._calibrated()
        clips = frozenset(problem.fitted)
        self.bounces = bounces(problem.impacts, problem.stacks, calibrated.fit, self.known, clips)
        self.restitution = None if "damping" in self.known.fit else fit_restitution(self.bounces)
        self.none = self.with_bounces(calibrated, False)

    def _calibrated(self) -> Candidate:
        """The model without effects, from several frictions: with too much of it bodies stop and nothing tells how
        much."""
        model = known_model(self.known, self.problem.stacks)
        sliding = [i for i, u in enumerate(model.unknowns) if u.name == "sliding_friction"]
        begin = starts_of(self.problem)
        best: Candidate | None = None
        for friction in FRICTIONS if sliding else (0.0,):
            theta = model.start
            theta[sliding] = friction
            found = self.fitted(self.problem, model, theta, begin, ())
            if best is None or found.bic < best.bic - 0.1:
                best = found
        assert best is not None
        return best

    def extended(self, base: Candidate, most: int = MOST_FITTED) -> list[Candidate]:
        """`base` with one effect more, best first: the `most` that the quick regression finds promising, and its
        equals."""
        quick = QuickRegression(base.problem.stacks, base.fit, base.problem.chosen)
        out, promising = [], []
        for kind in self.kinds:
            if kind.name in base.effects:
                continue
            if kind.name in ("hidden_obstacle", "restitution"):
                found = self._special(kind, base)
                if found is not None:
                    out.append(found)
                continue
            guesses = quick.guesses(kind, starts(kind, self.known, base.problem.stacks), self.known)
            promising.append((kind, guesses))
        promising.sort(key=lambda pair: -pair[1][0].gain)
        enough = promising[0][1][0].gain * WORTH_FITTING if promising else 0.0
        for number, (kind, guesses) in enumerate(promising):
            if number < most or (guesses[0].gain > enough and number < most + EQUALS):
                self.progress(kind.name)
                found = self._one(kind, base, guesses)
                if found is not None:
                    out.append(found)
        return sorted(out, key=lambda c: c.score)

    def _one(self, kind: EffectKind, base: Candidate, guesses: Sequence[Guess]) -> Candidate | None:
        best: Candidate | None = None
        tried = _apart(guesses) if kind.name == "hidden_attractor" and not base.effects else guesses[:BEGINNINGS]
        for guess in tried:
            if guess is not guesses[0] and guess.gain < WORTH_FITTING / 2 * guesses[0].gain:
                continue
            model = with_effect(base.fit.model, kind, self.known)
            low, high = (
                np.array([getattr(u, k) for u in model.unknowns[base.fit.model.size :]]) for k in ("low", "high")
            )
            theta = np.concatenate([base.fit.theta, np.clip(guess.values, low, high)])
            found = self.fitted(base.problem, model, theta, base.fit.starts, (*base.effects, kind.name))
            balls = any(s.grounded and (s.radius > 0).any() for s in base.problem.stacks)
            if found.fit.slipping or (balls and not base.effects):
                again = self.fitted(
                    base.problem, model, _unslipped(model, theta), starts_of(base.problem), found.effects
                )
                found = min(found, again, key=lambda c: c.score)
            found = self.with_bounces(found, "restitution" in base.effects)
            found = with_obstacle(found, base.obstacle, base.obstacle_price)
            if np.isfinite(found.score) and (best is None or found.score < best.score):
                best = found
        if best is not None and kind.name == "magnus_lift" and not self._spin_earns_its_place(base, best):
            return None
        return best

    def _special(self, kind: EffectKind, base: Candidate) -> Candidate | None:
        if kind.name == "restitution":
            if self.restitution is None:
                return None
            return replace(self.with_bounces(self._unbounced(base), True), effects=(*base.effects, kind.name))
        obstacle = fit_obstacle(self.problem.arcs, self.known)
        if obstacle is None or obstacle.misfit > OBSTACLE_MISFIT or base.obstacle is not None:
            return None
        if 2 * obstacle.hits < self.problem.jumps:
            return None
        split = split_at_jumps(base.problem)  # also where an outlier jumps: its pieces are paid for
        found = self.fitted(split, base.fit.model, base.fit.theta, starts_of(split), (*base.effects, kind.name))
        lost = max(base.problem.rows - split.rows, 0)
        added = sum(map(len, split.stacks)) - sum(map(len, base.problem.stacks))
        price = (
            5 * np.log(self.problem.effective_rows) + 6 * added + lost
        )  # a sphere and how it bounces; free restarts overfit
        found = with_obstacle(found, obstacle, price)
        return self.with_bounces(found, "restitution" in base.effects)

    def _spin_earns_its_place(self, base: Candidate, found: Candidate) -> bool:
        """Whether the measured spins explain more than those of other clips in their places."""
        stacks = found.problem.stacks
        spins = np.concatenate([s.spin for s in stacks])
        if np.linalg.norm(spins - spins.mean(0), axis=1).mean() < 0.2 * np.linalg.norm(spins, axis=1).mean():
            return True  # all the same: shuffling says nothing
        gain = base.score - found.score
        if gain < CLAIM:
            return True
        shuffled = [replace(s, spin=np.roll(s.spin, max(1, len(s) // 2), axis=0)) for s in stacks]
        begin = [np.concatenate([b[:, :6], s.spin, b[:, 9:]], 1) if not s.grounded else b
                 for b, s in zip(found.fit.starts, shuffled, strict=True)]  # fmt: skip
        copy = replace(found.problem, stacks=tuple(shuffled))
        other = self.with_bounces(self.fitted(copy, found.fit.model, found.fit.theta, begin, found.effects),
                                   "restitution" in base.effects)  # fmt: skip
        return base.score - other.score < SHUFFLED_SHARE * gain

    def one_less(self, found: Candidate) -> list[Candidate]:
        """`found` without one of its effects but the last: an effect that stood in for those that came after it is no
        longer needed with them."""
        out = []
        for name in found.effects[:-1]:
            if name not in found.fit.model.names:
                continue  # a restitution or an obstacle, which stand in for none
            model, kept = without_effect(found.fit.model, name)
            effects = tuple(e for e in found.effects if e != name)
            shorter = self.fitted(found.problem, model, found.fit.theta[kept], found.fit.starts, effects)
            shorter = self.with_bounces(shorter, "restitution" in effects)
            out.append(with_obstacle(shorter, found.obstacle, found.obstacle_price))
        return out

    def promises(self, base: Candidate, least: float) -> bool:
        """Whether a further effect would win by `least` in the quick regression: where the noise is taken from the best
        model itself, what it leaves cannot tell that it is not enough."""
        quick = QuickRegression(base.problem.stacks, base.fit, base.problem.chosen)
        share = self.problem.floor.information * self.sharper
        for kind in self.kinds:
            if kind.name not in (*base.effects, "hidden_obstacle", "restitution"):
                gain = quick.guesses(kind, starts(kind, self.known, base.problem.stacks), self.known)[0].gain * share
                if gain > least + kind.size * np.log(self.problem.effective_rows):
                    return True
        return False

    def sharpen(self, best: Candidate) -> None:
        """Take the noise from the best model, where that leaves less than polynomials do: they miss what turns fast or
        stops suddenly."""
        freedom = best.problem.rows - best.own
        left = best.left / max(freedom, 1)
        if best.obstacle is None and freedom > 30 and left < SHARPER:
            self.sharper = 1 / left

    def rescored(self, found: Candidate) -> Candidate:
        """The same with the noise that the best model leaves."""
        more = (self.sharper - 1) * self.problem.floor.information
        inside = more * found.fit.total(found.problem.chosen)
        outside = more * found.fit.total(found.problem.held)
        return replace(found, score=found.score + inside + outside, bic=found.bic + inside,
                       held_out=found.held_out + outside)  # fmt: skip

    def fitted(
        self, problem: Problem, model: Model, theta: np.ndarray, begin: Sequence[np.ndarray], effects: tuple[str, ...]
    ) -> Candidate:
        iterations = MOST_ITERATIONS if len(effects) < 2 else MOST_ITERATIONS // 2
        found = fit(problem.stacks, model, theta, begin, problem.chosen, iterations)
        other = unstuck(problem.stacks, found)
        if other is not None:
            found = fit(problem.stacks, model, found.theta, other, problem.chosen, iterations)
        share = problem.floor.information * self.sharper
        inside, outside = found.total(problem.chosen) * share, found.total(problem.held) * share
        bic = inside + model.size * np.log(self.problem.effective_rows) + found.slip_price
        return Candidate(effects, found, problem, bic + outside, bic, outside)

    def with_bounces(self, found: Candidate, free: bool) -> Candidate:
        """With the bounces' part of the score: as known damping has them, or with a restitution of their own."""
        if self.restitution is None:
            return found
        found = replace(found, restitution=self.restitution if free else None)
        term = self.bounce_chi2(found) + (np.log(max(len(self.bounces), 2)) if free else 0.0)
        return replace(found, score=found.score + term, bic=found.bic + term)

    def _unbounced(self, found: Candidate) -> Candidate:
        term = self.bounce_chi2(found)
        return replace(found, score=found.score - term, bic=found.bic - term)

    def bounce_chi2(self, found: Candidate) -> float:
        """Chi squared of the bounces: by a restitution of their own, or as known damping has them."""
        if self.restitution is None:
            return 0.0
        return self.restitution.chi2 if found.restitution else self.restitution.chi2_expected


def _unslipped(model: Model, theta: np.ndarray) -> np.ndarray:
    """theta with frictions as stated: without the effect they may have been far off to make up for it."""
    return np.where([u.owner.startswith("object:") for u in model.unknowns], model.start, theta)


def _apart(guesses: Sequence[Guess]) -> list[Guess]:
    """The best of the guesses of a place that are well apart from each other."""
    places = np.array([g.values[:3] for g in guesses])
    spacing = float(np.ptp(places, axis=0).max()) / 3
    out: list[Guess] = []
    for guess in guesses:
        if all(np.linalg.norm(guess.values[:3] - other.values[:3]) > spacing for other in out):
            out.append(guess)
    return out[:MANY_BEGINNINGS]
