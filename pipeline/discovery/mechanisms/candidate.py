"""A model of a mechanism that may explain the log, fitted and scored as the models of free bodies are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.mechanisms.least_squares import Fit
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.selection.shorter import LEAST_REMAINDER
from pipeline.discovery.tracks.noise import correlation

FOLLOWS = 0.1  # of a column's standard deviation: a model whose misfit is smaller is near enough to be linearised


@dataclass(frozen=True)
class Noise:
    """What residuals count as noise.

    Attributes:
        variance: Of a number, in units of the noise of its column.
        information: Independent numbers per number.
    """

    variance: float = 1.0
    information: float = 1.0


UNIT = Noise()


@dataclass(frozen=True)
class Candidate:
    """A fitted model.

    Attributes:
        problem: What it was fitted to.
        fit: Of the model.
        noise: Of its score.
        near: The same model, fitted to the windows in which effects race; None where these are the same.
    """

    problem: Problem
    fit: Fit
    noise: Noise = UNIT
    near: Candidate | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Names, in the order in which they were added."""
        return self.fit.model.effects

    @property
    def bic(self) -> float:
        """Chi squared of the fitted windows, and the price of the numbers that they determine."""
        independent = max(self.problem.count * self.noise.information, 2.0)
        return self._chi2(self.problem.chosen) + self.fit.determined * float(np.log(independent))

    @property
    def held_out(self) -> float:
        """Chi squared of the held-out windows and of the forecasts."""
        ahead = sum(f.chi2 for f in self.fit.ahead) * self.noise.information / self.noise.variance
        return self._chi2(~self.problem.chosen) + ahead

    @property
    def score(self) -> float:
        """What models are compared by."""
        return self.bic + self.held_out

    @property
    def freedom(self) -> float:
        """Degrees of freedom of all windows."""
        own = min(self.fit.states.size, len(self.problem.log.channels) * 2) * len(self.problem.windows)
        return max(self.problem.count - own - self.fit.determined, 1.0)

    @property
    def variance(self) -> float:
        """Mean square of the residuals, in units of the noise of each column."""
        return float(self.fit.chi2.sum()) / self.freedom

    @property
    def follows(self) -> bool:
        """Whether the model stays near the motion in all its columns."""
        problem = self.problem
        columns = range(len(problem.log.channels))
        left = np.concatenate([*self.fit.residual, *(f.residual for f in self.fit.ahead)])
        which = np.concatenate(
            [*map(problem.columns, range(len(problem.windows))), *(f.columns for f in self.fit.ahead)]
        )
        for c in columns:
            every = np.concatenate([clip.values[:, c] for clip in problem.log.clips])
            spread = max(float(np.nanstd(every)) / problem.sigma[c], 1.0)
            if (which == c).any() and np.sqrt((left[which == c] ** 2).mean()) > FOLLOWS * spread:
                return False
        return True

    @property
    def near_noise(self) -> bool:
        """Whether what the model leaves may be noise."""
        return self.variance <= LEAST_REMAINDER**2

    def rescored(self, noise: Noise) -> Candidate:
        """The candidate, scored with other noise."""
        return replace(self, noise=noise)

    def _chi2(self, windows: np.ndarray) -> float:
        return float(self.fit.chi2[windows].sum()) * self.noise.information / self.noise.variance


def noise_of(found: Candidate) -> Noise:
    """The noise, where what a model leaves is noise: models are never quite right, and sensors are often filtered.

    The residuals are taken to be an autoregression of first order, of which a number counts (1 - r) / (1 + r).
    """
    problem, rows = found.problem, []
    for w, left in enumerate(found.fit.residual):
        which = problem.columns(w)
        rows += [left[which == c][:, None] for c in np.unique(which)]
    own = problem.count - found.freedom
    r = correlation(rows, int(own))
    return Noise(max(found.variance, 1e-12), (1 - r) / (1 + r))


def excess_z(found: Candidate, information: float) -> float:
    """How far what a model leaves exceeds the noise of the columns, in standard deviations.

    information: independent numbers per number.
    """
    freedom = found.freedom * information
    return float((found.variance * freedom - freedom) / np.sqrt(2 * freedom))
