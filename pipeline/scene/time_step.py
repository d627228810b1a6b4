"""The time step of every simulation."""

import numpy as np

STEPS_PER_SECOND = 240


def frame_steps(times: np.ndarray) -> np.ndarray:
    """(T,) The simulation steps that are nearest to times (T,), s."""
    return np.asarray(np.rint(np.asarray(times) * STEPS_PER_SECOND).astype(np.int64))
