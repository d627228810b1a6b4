"""The gap between a model and the log: the error of joints on what was not fitted."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.log import Quantity
from pipeline.discovery.selection.gap import Gap


def measure_gap(before: Candidate, after: Candidate) -> Gap:
    """The gap on the held-out windows and forecasts, or on the fitted windows where there are none.

    Root mean square over the measured joints, rad or m; over all columns where no joint was measured.

    Args:
        before: The calibrated model.
        after: The model with the effects found.
    """
    problem = before.problem
    held = ~problem.chosen if problem.judged else problem.chosen
    clips = problem.clips["held_out" if problem.judged else "fitted"]
    first, last, everything = _rmse(before, held), _rmse(after, held), _rmse(after, np.ones(len(held), bool))
    columns = _columns(before)
    counts = np.array([sum(np.isfinite(c.values[:, k]).sum() for c in problem.log.clips) for k in columns])
    sigma = float(np.sqrt((counts * problem.sigma[columns] ** 2).sum() / max(counts.sum(), 1)))
    return Gap(first, last, min(sigma, everything), tuple(clips))


def gap_unit(found: Candidate) -> str:
    """Unit of the gap: rad or m; of both kinds of joints together "rad, m"."""
    return ", ".join(dict.fromkeys(found.problem.log.channels[k].unit for k in _columns(found)))


def _columns(found: Candidate) -> list[int]:
    channels = found.problem.log.channels
    joints = [k for k, c in enumerate(channels) if c.quantity is Quantity.JOINT]
    return joints or list(range(len(channels)))


def _rmse(found: Candidate, windows: np.ndarray) -> float:
    """Over some windows (W,) bool. The initial states cost degrees of freedom, in the share of these columns."""
    problem, squares, count, own = found.problem, 0.0, 0, 0.0
    columns = _columns(found)
    for w in np.flatnonzero(windows):
        which = problem.columns(int(w))
        mine = np.isin(which, columns)
        squares += float(((found.fit.residual[w] * problem.sigma[which])[mine] ** 2).sum())
        count += int(mine.sum())
        own += min(found.fit.states.size, 2 * len(problem.log.channels)) * mine.sum() / max(len(which), 1)
    for forecast in found.fit.ahead:
        mine = np.isin(forecast.columns, columns)
        squares += float(((forecast.residual * problem.sigma[forecast.columns])[mine] ** 2).sum())
        count += int(mine.sum())
    return float(np.sqrt(squares / max(count - own, 1)))
