"""MuJoCo's contact damping ratio and the restitution that it gives."""

from __future__ import annotations

import numpy as np

#: Contact damping ratio -> restitution of a ball that meets the ground at 1.5 to 3 m/s, mean over the phase of the
#: 1/240 s step, which changes single impacts by up to 0.09. Measured with MuJoCo 3.17.
DAMPING = np.array([0.005, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55,
                    0.6, 0.65, 0.7, 0.75, 0.8, 0.9])  # fmt: skip
RESTITUTION = np.array([0.9682, 0.9532, 0.9236, 0.8698, 0.8184, 0.7724, 0.7281, 0.6501, 0.5803, 0.5192, 0.4634,
                        0.4123, 0.3489, 0.3022, 0.255, 0.2152, 0.1761, 0.1391, 0.0985, 0.0578, 0.0294,
                        0.0097, 0.0])  # fmt: skip
SCATTER = 0.06  # standard deviation of single impacts about the table


def restitution_of(damping: float) -> float:
    """The restitution of a contact damping ratio."""
    return float(np.interp(damping, DAMPING, RESTITUTION))


def damping_of(restitution: float) -> float:
    """The contact damping ratio of a restitution; above 0.968 that of 0.968."""
    return float(np.interp(-restitution, -RESTITUTION, DAMPING))
