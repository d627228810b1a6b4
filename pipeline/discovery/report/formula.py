"""The force that no listed effect explains, as a formula: sparse regression in trajectory space.

The accelerations of a library are integrated twice along the measured paths. Terms are added one by one, by BIC.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate, residuals_m

MOST_TERMS = 4
AXES = "xyz"


def residual_formula(found: Candidate) -> str:
    """The residual force of a model, as `F/m = ...` in SI units; `not found` where no term helps."""
    names, columns, target = _design(found)
    if not names:
        return "not found"
    count = max(len(target), 2)
    size = np.sqrt((columns**2).sum(1))
    usable = [k for k in range(len(names)) if size[k] > 1e-9]
    chosen: list[int] = []
    best = float(target @ target)
    beta = np.zeros(0)
    for _ in range(MOST_TERMS):
        trials = []
        for k in usable:
            if k not in chosen:
                design = columns[[*chosen, k]].T
                b, *_ = np.linalg.lstsq(design, target, rcond=None)
                trials.append((float(((target - design @ b) ** 2).sum()), k, b))
        if not trials:
            break
        left, k, b = min(trials, key=lambda trial: trial[0])
        if best - left < 2 * np.log(count) + 8:
            break
        chosen, best, beta = [*chosen, k], left, b
    if not chosen:
        return "not found"
    terms = " ".join(f"{'+' if c >= 0 else '-'} {abs(c):.3g} {names[k]}" for k, c in zip(chosen, beta, strict=True))
    explained = 1 - best / max(float(target @ target), 1e-12)
    return f"F/m = {terms} ({explained:.0%} of the residual)"


def _library(x: np.ndarray, v: np.ndarray, spin: np.ndarray, t: np.ndarray) -> Mapping[str, np.ndarray]:
    """Name -> acceleration (n, 3), along a path of positions and velocities (n, 3)."""
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    out: dict[str, np.ndarray] = {f"e_{a}": np.tile(np.eye(3)[i], (len(x), 1)) for i, a in enumerate(AXES)}
    out |= {"v": v, "|v| v": speed * v, "|v|^2 v": speed**2 * v, "e_z x v": np.cross([0.0, 0, 1], v)}
    out |= {"w x v": np.cross(spin, v), "r": x}
    for i, a in enumerate(AXES):
        for j, b in enumerate(AXES):
            out[f"{a} e_{b}"] = x[:, [i]] * np.eye(3)[j]
    for i, a in enumerate(AXES):
        out[f"t e_{a}"] = t[:, None] * np.eye(3)[i]
    return out


def _design(found: Candidate) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, columns (terms, rows) and target (rows,) of the regression, in units of sigma, without what the initial
    states can do."""
    problem = found.problem
    names: list[str] = []
    blocks, targets = [], []
    for stack, part, rows in zip(problem.stacks, problem.polynomials, residuals_m(problem, found), strict=True):
        for i in range(len(stack)):
            there = stack.weight[i].max(1) > 0
            t, weight = stack.time[i, there], stack.weight[i, there]
            if len(t) < 6:
                continue
            x = part.fitted[i]
            v = np.gradient(x, t, axis=0)
            straight = np.column_stack([np.ones_like(t), t])
            project = np.eye(len(t)) - straight @ np.linalg.pinv(straight)
            library = _library(x, v, np.tile(stack.spin[i], (len(t), 1)), t + stack.start[i])
            names = list(library)
            columns = [(project @ _twice(a, t)) * weight for a in library.values()]
            blocks.append(np.array([c.ravel() for c in columns]))
            targets.append(((project @ rows[i, there]) * weight).ravel())
    if not blocks:
        return [], np.zeros((0, 0)), np.zeros(0)
    return names, np.concatenate(blocks, 1), np.concatenate(targets)


def _twice(acceleration: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) of an acceleration (n, 3) from rest, by the trapezoidal rule."""
    dt = np.diff(t)[:, None]
    zero = np.zeros((1, 3))
    velocity = np.concatenate([zero, np.cumsum((acceleration[1:] + acceleration[:-1]) / 2 * dt, 0)])
    return np.concatenate([zero, np.cumsum((velocity[1:] + velocity[:-1]) / 2 * dt, 0)])
