"""Quick regression: how much of what a fitted model leaves would an effect explain, to first order.

Each start of an effect is switched on a little; what that does to the predictions, less what initial states and fitted
parameters could do as well, is regressed on the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.fit import Fit, Linear, linearise, local_inverse, run
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.model import Model, with_effect
from pipeline.discrepancy.stack import ArcStack
from pipeline.discrepancy.starts import Start
from pipeline.scene.effects.kind import EffectKind

BATCH = 32  # starts that are integrated at a time


@dataclass(frozen=True)
class Guess:
    """values (k,): the effect's numbers to begin a fit with; gain: by how much chi squared may fall."""

    values: np.ndarray
    gain: float


class QuickRegression:
    """Residuals and derivatives of a fitted model, for many effects to be tried on."""

    def __init__(self, stacks: Sequence[ArcStack], found: Fit, fitted: Sequence[np.ndarray]) -> None:
        self.stacks, self.found, self.fitted = stacks, found, fitted
        self.linear: Linear = linearise(stacks, found.model, found.theta, found.starts)
        self._inverse = [local_inverse(s, jl) for s, jl in zip(stacks, self.linear.local, strict=True)]
        self._residual = self._flat([self._projected(i, r[:, None])[:, 0] for i, r in enumerate(self.linear.residual)])
        known = [self._projected(i, j) for i, j in enumerate(self.linear.shared)]
        free = [g for g, u in enumerate(found.model.unknowns) if u.low + u.step < found.theta[g] < u.high - u.step]
        columns = [self._flat([k[:, g] for k in known]) for g in free]  # a number at its bound takes nothing more
        self._known = np.array(columns).reshape(len(columns), len(self._residual))

    def _projected(self, stack: int, rows: np.ndarray) -> np.ndarray:
        """Rows (A, D, R) without what the initial states can do."""
        local = self.linear.local[stack]
        reach = np.einsum("alm,amr,adr->adl", self._inverse[stack], local, rows, optimize=True)
        return rows - np.einsum("adl,alr->adr", reach, local)

    def _flat(self, parts: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([p[m].ravel() for p, m in zip(parts, self.fitted, strict=True)])

    def guesses(self, kind: EffectKind, starts: Sequence[Start], known: KnownScene) -> list[Guess]:
        """One for each start, the best first."""
        out = []
        for begin in range(0, len(starts), BATCH):
            out += self._batch(kind, starts[begin : begin + BATCH], known)
        return sorted(out, key=lambda g: -g.gain)

    def _batch(self, kind: EffectKind, starts: Sequence[Start], known: KnownScene) -> list[Guess]:
        model: Model = with_effect(self.found.model, kind, known)
        own = np.concatenate([np.vstack([s.centre, s.centre + s.directions]) for s in starts])
        theta = np.hstack([np.tile(self.found.theta, (len(own), 1)), own])
        changes = []
        for i, (stack, start) in enumerate(zip(self.stacks, self.found.starts, strict=True)):
            with np.errstate(all="ignore"):
                rows, _ = run(stack, model, theta, np.broadcast_to(start, (len(own), *start.shape)))
            place, parts = 0, []
            for s in starts:
                parts.append(rows[place + 1 : place + 1 + len(s.directions)] - rows[place])
                place += 1 + len(s.directions)
            changes.append(self._projected(i, np.concatenate(parts).transpose(1, 0, 2)))
        out, place = [], 0
        for s in starts:
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
        beta = (
            np.linalg.lstsq(gram / np.outer(size, size) + 1e-10 * np.eye(len(size)), right / size, rcond=None)[0] / size
        )
        gain = float(beta @ right)
        amplitude = beta[: len(columns)]
        return Guess(start.centre + amplitude @ start.directions, gain)
