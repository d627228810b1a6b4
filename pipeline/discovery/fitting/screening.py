"""Screening regression: how much of a fitted model's residuals an effect would explain, to first order.

Each start of an effect is switched on a little. The change of the predictions, less what the initial states and the
fitted parameters could do as well, is regressed on the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.least_squares import Fit
from pipeline.discovery.fitting.model import Model, neutral_value, with_effect
from pipeline.discovery.fitting.predictions import linearise, run
from pipeline.discovery.fitting.priors import own_covariance
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.effects.discovery_rules import Observed, Start
from pipeline.scene.effects.kind import EffectKind

BATCH = 32  # starts that are integrated at a time
START_STEP = 0.05  # of a parameter's scale, by which an effect is switched on


@dataclass(frozen=True)
class Guess:
    """values (k,): the effect's numbers to begin a fit with; gain: by how much chi squared may fall."""

    values: np.ndarray
    gain: float


def starts(kind: EffectKind, problem: Problem) -> list[Start]:
    """Where fits of an effect begin: as its rules say, by default at no effect, with a direction for each number."""
    if kind.discovery.starts is not None:
        stacks = problem.stacks
        points = np.concatenate([s.position[s.weight.max(2) > 0] for s in stacks])
        first = min(float(s.start.min()) for s in stacks)
        last = max(float((s.start + s.duration).max()) for s in stacks)
        return list(kind.discovery.starts(Observed(points, first, last)))
    scale = np.concatenate([np.full(p.length, p.scale) for p in kind.parameters])
    neutral = np.concatenate([np.full(p.length, neutral_value(p, problem.known)) for p in kind.parameters])
    return [Start(neutral, START_STEP * np.diag(scale))]


class ScreeningRegression:
    """Residuals and derivatives of a fitted model, on which effects are tried."""

    def __init__(self, problem: Problem, found: Fit) -> None:
        self._problem, self._found = problem, found
        linear = linearise(problem.stacks, found.model, found.theta, found.starts)
        self._local = linear.local
        self._own = [own_covariance(s, jl) for s, jl in zip(problem.stacks, linear.local, strict=True)]
        self._residual = self._flat([self._projected(i, r[:, None])[:, 0] for i, r in enumerate(linear.residual)])
        known = [self._projected(i, j) for i, j in enumerate(linear.shared)]
        unknowns = enumerate(found.model.unknowns)
        # a number at its bound cannot take over what an effect does
        free = [g for g, u in unknowns if u.low + u.step < found.theta[g] < u.high - u.step]
        columns = [self._flat([k[:, g] for k in known]) for g in free]
        self._known = np.array(columns).reshape(len(columns), len(self._residual))

    def guesses(self, kind: EffectKind) -> list[Guess]:
        """One for each start of the effect, the best first."""
        begin, out = starts(kind, self._problem), []
        for first in range(0, len(begin), BATCH):
            out += self._batch(kind, begin[first : first + BATCH])
        return sorted(out, key=lambda g: -g.gain)

    def _projected(self, stack: int, rows: np.ndarray) -> np.ndarray:
        """Rows (A, D, R) without what the initial states can do."""
        local = self._local[stack]
        reach = np.einsum("alm,amr,adr->adl", self._own[stack], local, rows, optimize=True)
        return rows - np.einsum("adl,alr->adr", reach, local)

    def _flat(self, parts: list[np.ndarray]) -> np.ndarray:
        """The rows of the fitted arcs of all stacks, (rows,)."""
        return np.concatenate([p[m].ravel() for p, m in zip(parts, self._problem.chosen, strict=True)])

    def _batch(self, kind: EffectKind, begin: Sequence[Start]) -> list[Guess]:
        model: Model = with_effect(self._found.model, kind, self._problem.known)
        own = np.concatenate([np.vstack([s.centre, s.centre + s.directions]) for s in begin])
        theta = np.hstack([np.tile(self._found.theta, (len(own), 1)), own])
        changes = []
        for i, (stack, states) in enumerate(zip(self._problem.stacks, self._found.starts, strict=True)):
            with np.errstate(all="ignore"):
                rows, _ = run(stack, model, theta, np.broadcast_to(states, (len(own), *states.shape)))
            place, parts = 0, []
            for s in begin:
                parts.append(rows[place + 1 : place + 1 + len(s.directions)] - rows[place])
                place += 1 + len(s.directions)
            changes.append(self._projected(i, np.concatenate(parts).transpose(1, 0, 2)))
        out, place = [], 0
        for s in begin:
            count = len(s.directions)
            columns = [self._flat([c[:, place + d] for c in changes]) for d in range(count)]
            place += count
            out.append(self._guess(s, np.array(columns)))
        return out

    def _guess(self, start: Start, columns: np.ndarray) -> Guess:
        design = np.vstack([columns, self._known])
        with np.errstate(all="ignore"):
            usable = np.isfinite(design).all()
        if not usable:
            return Guess(start.centre, 0.0)
        gram = design @ design.T
        size = np.sqrt(np.maximum(np.diag(gram), 1e-20))
        right = design @ self._residual
        scaled = gram / np.outer(size, size) + 1e-10 * np.eye(len(size))
        beta = np.linalg.lstsq(scaled, right / size, rcond=None)[0] / size
        gain = float(beta @ right)
        amplitude = beta[: len(columns)]
        return Guess(start.centre + amplitude @ start.directions, gain)
