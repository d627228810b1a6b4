"""Controls that are held until the next row of the log, at any time, and through a lag."""

from __future__ import annotations

import numpy as np


def held(time: np.ndarray, control: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The mean of a held control over each interval of `at`.

    The mean, rather than the value at the beginning, makes it a continuous function of the times.

    Args:
        time: (T,) s, of the rows.
        control: (T,) of the rows; the first one is taken to have been held before, too.
        at: (n + 1,) s, ends of n intervals.

    Returns:
        (n,)
    """
    integral = np.concatenate([[0.0], np.cumsum(control[:-1] * np.diff(time))])
    row = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)
    until = integral[row] + control[row] * (at - time[row])
    return np.asarray(np.diff(until) / np.maximum(np.diff(at), 1e-12))


def lagged(time: np.ndarray, control: np.ndarray, at: np.ndarray, time_constant: float) -> np.ndarray:
    """A held control behind a lag of first order, in the middle of each interval of `at` (n + 1,), (n,).

    It is exact: between two rows the lag approaches the control exponentially. It begins at the first control.
    """
    decay = np.exp(-np.diff(time) / time_constant)
    state = np.empty(len(time))
    state[0] = control[0]
    for k in range(len(time) - 1):
        state[k + 1] = control[k] + (state[k] - control[k]) * decay[k]
    middle = (at[1:] + at[:-1]) / 2
    row = np.clip(np.searchsorted(time, middle, side="right") - 1, 0, len(time) - 1)
    since = np.maximum(middle - time[row], 0.0)
    return np.asarray(control[row] + (state[row] - control[row]) * np.exp(-since / time_constant))
