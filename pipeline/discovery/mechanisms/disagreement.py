"""Where the known model and the log disagree: short windows with the force that a joint misses there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.log import Quantity

NOTABLE_Z = 4.0  # of a window in which something is missing; noise alone reaches it once in 16,000 windows
NOISE_TAIL = 6.3e-5  # probability that noise alone does
STANDS = 3.0  # of the noise: a joint that moves less in a window is at rest
LEAST_ROWS = 4


@dataclass(frozen=True)
class MissingForce:
    """What a joint misses in a window.

    Attributes:
        clip: Which recording.
        joint: Its name.
        start, end: s.
        regime: What it is doing.
        force: N m or N.
        unit: Of the force.
        z: In standard errors.
        direction: In words.
        position, velocity, control: Means in the window; control: of the first actuator that drives the joint.
        acceleration: The force over the joint's inertia.
    """

    clip: str
    joint: str
    start: float
    end: float
    regime: str
    force: float
    unit: str
    z: float
    direction: str
    position: float
    velocity: float
    control: float
    acceleration: float


def missing_forces(found: Candidate) -> list[MissingForce]:
    """The missing force of each measured joint in each window of a model, in the order of time.

    A constant force bends the residuals of a window to a parabola; the joint's inertia is that of the initial
    configuration.
    """
    problem, out = found.problem, []
    model = problem.mechanism.model
    for w, window in enumerate(problem.windows):
        clip = problem.log.clips[window.clip]
        which = problem.columns(w)
        for c, channel in enumerate(problem.log.channels):
            if channel.quantity is not Quantity.JOINT or (which == c).sum() < LEAST_ROWS:
                continue
            joint = problem.mechanism.joint(channel.name)
            q = clip.values[window.rows, c]
            there = np.isfinite(q)
            t, q = clip.time[window.rows][there], q[there]
            left = found.fit.residual[w][which == c] * problem.sigma[c]
            tau = t - t.mean()
            design = np.column_stack([np.ones_like(tau), tau, tau * tau / 2])
            inverse = np.linalg.pinv(design.T @ design)
            acceleration = float((inverse @ (design.T @ left))[2])
            error = float(problem.sigma[c] * np.sqrt(inverse[2, 2]))
            velocity = np.gradient(q, t)
            drives = [k for k in range(model.nu) if model.actuator_trnid[k, 0] == model.joint(joint.name).id]
            control = float(clip.controls[window.rows, drives[0]].mean()) if drives else 0.0
            out.append(
                MissingForce(
                    clip=clip.name,
                    joint=joint.name,
                    start=float(t[0]),
                    end=float(t[-1]),
                    regime=_regime(q, velocity, float(problem.sigma[c])),
                    force=acceleration * float(model.dof_M0[joint.velocity]),
                    unit="N" if joint.slide else "N m",
                    z=abs(acceleration) / max(error, 1e-12),
                    direction=_direction(acceleration, float(velocity.mean())),
                    position=float(q.mean()),
                    velocity=float(velocity.mean()),
                    control=control,
                    acceleration=acceleration,
                )
            )
    return out


def disagreement(found: Candidate) -> list[MissingForce]:
    """The windows in which something is missing, the strongest first."""
    return sorted((f for f in missing_forces(found) if f.z >= NOTABLE_Z), key=lambda f: -f.z)


def where_dict(found: Candidate) -> dict[str, Any] | None:
    """The joints at which something is missing, and in which share of the windows; None where it is nowhere."""
    every = missing_forces(found)
    off = [f for f in every if f.z >= NOTABLE_Z]
    if not off:
        return None
    return {
        "only": {},
        "objects": list(dict.fromkeys(f.joint for f in off)),
        "share": len(off) / len(every),
        "agreement": 1.0,
        "false_discovery_rate": min(1.0, NOISE_TAIL * len(every) / len(off)),
    }


def row(f: MissingForce) -> dict[str, Any]:
    """As in report.json."""
    return {
        "clip": f.clip,
        "object": f.joint,
        "t_start": f.start,
        "t_end": f.end,
        "regime": f.regime,
        "residual": abs(f.force),
        "unit": f.unit,
        "z_score": f.z,
        "direction": f.direction,
    }


def _regime(position: np.ndarray, velocity: np.ndarray, sigma: float) -> str:
    if np.ptp(position) < STANDS * 2 * sigma:
        return "resting"
    rising = velocity[np.abs(velocity) > 0.1 * np.abs(velocity).max()] > 0
    return "moving" if rising.all() or not rising.any() else "reversing"


def _direction(force: float, velocity: float) -> str:
    sign = "positive" if force > 0 else "negative"
    return f"{sign}, {'along' if force * velocity > 0 else 'against'} the motion"
