"""The force that no listed effect explains, as a formula: sparse regression of the missing forces of windows."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.disagreement import missing_forces

MOST_TERMS = 3
LEAST_WINDOWS = 8
NOT_FOUND = "not found"


def missing_form(found: Candidate) -> str:
    """The missing acceleration of the joint that misses most, as a formula of its motion in SI units.

    Terms are added one by one, by BIC.
    """
    every = missing_forces(found)
    joints = {f.joint for f in every}
    if not joints:
        return NOT_FOUND
    joint = max(joints, key=lambda j: sum(f.z**2 for f in every if f.joint == j))
    mine = [f for f in every if f.joint == joint]
    if len(mine) < LEAST_WINDOWS:
        return NOT_FOUND
    target = np.array([f.acceleration for f in mine])
    weight = np.array([f.z / max(abs(f.acceleration), 1e-12) for f in mine])
    q, v = np.array([f.position for f in mine]), np.array([f.velocity for f in mine])
    u, t = np.array([f.control for f in mine]), np.array([f.start for f in mine])
    library = {
        "1": np.ones_like(q),
        "q": q,
        "q^3": q**3,
        "sin q": np.sin(q),
        "cos q": np.cos(q),
        "v": v,
        "sign v": np.sign(v),
        "|v| v": np.abs(v) * v,
        "u": u,
        "t": t,
    }
    names = [n for n, x in library.items() if n == "1" or np.ptp(x) > 1e-9]
    chosen: list[str] = []
    best, beta = float(((weight * target) ** 2).sum()), np.zeros(0)
    whole, noise = best, 1.0
    while len(chosen) < MOST_TERMS:
        trials = []
        for name in names:
            if name not in chosen:
                design = np.stack([library[n] for n in (*chosen, name)], 1) * weight[:, None]
                b, *_ = np.linalg.lstsq(design, weight * target, rcond=None)
                trials.append((float(((weight * target - design @ b) ** 2).sum()), name, b))
        left, name, b = min(trials, key=lambda trial: trial[0])
        noise = max(left / max(len(mine) - len(chosen) - 1, 1), 1.0)
        if (best - left) / noise < np.log(len(mine)):
            break
        chosen, best, beta = [*chosen, name], left, b
    if not chosen:
        return NOT_FOUND
    terms = " ".join(f"{'+' if c >= 0 else '-'} {abs(c):.3g} {n}" for n, c in zip(chosen, beta, strict=True))
    return f"acceleration of {joint} = {terms} ({1 - best / whole:.0%} of what is missing)"
