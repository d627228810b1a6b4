"""The problem that models are fitted to: windows of the log, the noise of its columns, and what simulates it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.discovery.mechanisms.kind import Place, Target
from pipeline.discovery.mechanisms.log import Log, Quantity
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.discovery.mechanisms.places import motion
from pipeline.discovery.mechanisms.simulation import Simulator, States, Window
from pipeline.discovery.mechanisms.windows import guessed_states

UNMEASURED = (2.0, 5.0)  # rad or m, and per s: where a joint that was not measured may begin
WIDE = 10.0  # spreads of a measured motion: the weak prior of where it begins
OWN_STEP = 1e-7  # of the spread: the step of finite differences of initial states


@dataclass(frozen=True)
class Problem:
    """One cut of the log into windows.

    Attributes:
        mechanism: The user's model.
        log: The log.
        simulator: What predicts windows.
        windows: W stretches.
        sigma: (C,) noise of the columns.
        places: Where effects may act.
    """

    mechanism: Mechanism
    log: Log
    simulator: Simulator
    windows: tuple[Window, ...]
    sigma: np.ndarray
    places: dict[Target, tuple[Place, ...]]

    def simulated_by(self, simulator: Simulator) -> Problem:
        """The problem with other settings of the simulation."""
        return replace(self, simulator=simulator)

    def cut(self, windows: tuple[Window, ...]) -> Problem:
        """The problem with other windows of the same log."""
        return replace(self, windows=windows)

    @cached_property
    def chosen(self) -> np.ndarray:
        """(W,) bool: the windows that are fitted."""
        return np.array([not w.held for w in self.windows])

    @cached_property
    def ahead(self) -> list[int]:
        """The windows that make a forecast."""
        return [k for k, w in enumerate(self.windows) if w.ahead is not None]

    @property
    def judged(self) -> bool:
        """Whether something is held out."""
        return bool(self.ahead) or not self.chosen.all()

    @cached_property
    def forecast(self) -> Problem:
        """The windows that make a forecast, with the rows of the forecast."""
        return self.cut(
            tuple(
                replace(w, rows=slice(w.rows.start, w.ahead.stop), ahead=None)
                for w in self.windows
                if w.ahead is not None
            )
        )

    @cached_property
    def guessed(self) -> States:
        """Where windows begin, as their first measurements tell."""
        return guessed_states(self.mechanism, self.log, self.windows)

    @cached_property
    def targets(self) -> list[np.ndarray]:
        """What was measured in each window in units of its noise, (numbers,)."""
        return [self.rows(k, self.log.clips[w.clip].values[w.rows]) for k, w in enumerate(self.windows)]

    @cached_property
    def _there(self) -> list[np.ndarray]:
        return [np.isfinite(self.log.clips[w.clip].values[w.rows]) for w in self.windows]

    def rows(self, window: int, values: np.ndarray) -> np.ndarray:
        """Of values (rows, C) those that were measured, in units of their noise, (numbers,); column by column."""
        return np.asarray((values / self.sigma).T[self._there[window].T])

    def columns(self, window: int) -> np.ndarray:
        """Which column each number of `rows` is of."""
        there = self._there[window]
        return np.repeat(np.arange(there.shape[1]), there.sum(0))

    @cached_property
    def count(self) -> int:
        """Number of measured numbers."""
        return int(sum(len(t) for t in self.targets))

    @cached_property
    def scales(self) -> np.ndarray:
        """(own,) sizes of the changes of an initial state: of positions, velocities and activations."""
        nv, na = self.mechanism.model.nv, self.mechanism.model.na
        out = np.ones(2 * nv + na)
        for joint in self.mechanism.joints:
            seen = motion(self.log, joint)
            if seen is not None:
                out[joint.velocity] = max(float(np.ptp(seen[0])), 1e-3)
                out[nv + joint.velocity] = max(seen[1], 1e-3)
        return out

    @cached_property
    def prior(self) -> np.ndarray:
        """(own,) precisions of the weak priors of an initial state."""
        nv, na = self.mechanism.model.nv, self.mechanism.model.na
        sigma = np.concatenate([np.full(nv, UNMEASURED[0]), np.full(nv, UNMEASURED[1]), np.ones(na)])
        for joint in self.mechanism.joints:
            if self.log.column(Quantity.JOINT, joint.name) is not None:
                sigma[joint.velocity] = WIDE * self.scales[joint.velocity]
                sigma[nv + joint.velocity] = WIDE * self.scales[nv + joint.velocity]
        return np.asarray(1 / sigma**2)

    def state_information(self, own: np.ndarray) -> np.ndarray:
        """What a window and the weak priors tell of its initial state, (L, L), from derivatives by it (L, numbers)."""
        return np.asarray(own @ own.T + np.diag(self.prior))

    def state_covariance(self, own: np.ndarray) -> np.ndarray:
        """Covariance (L, L) of an initial state, from derivatives by it (L, numbers), which may be any where the motion
        diverges."""
        return np.linalg.pinv(self.state_information(own), hermitian=True)

    @cached_property
    def clips(self) -> dict[str, list[str]]:
        """Names of the fitted and of the held-out clips."""
        names = [c.name for c in self.log.clips]
        return {
            "fitted": [names[k] for k in dict.fromkeys(w.clip for w in self.windows if not w.held)],
            "held_out": [
                names[k] for k in dict.fromkeys(w.clip for w in self.windows if w.held or w.ahead is not None)
            ],
        }


def predicted(problem: Problem, jobs: Sequence[tuple[int, int]], values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The numbers of each job, (numbers,), in units of their noise."""
    return [problem.rows(w, v) for (w, _), v in zip(jobs, values, strict=True)]
