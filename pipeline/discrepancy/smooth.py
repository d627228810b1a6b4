"""Arcs as polynomials in time: what a recording holds without any physics, and so how noisy it is.

The degree is shared by all arcs and chosen by BIC; jumps of velocity that nothing explains are part of it. What is
left is noise: its size, whether it is white, and which samples are outliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.breaks import Break
from pipeline.discrepancy.noise import MAD, correlation
from pipeline.discrepancy.stack import ArcStack

DEGREES = (*range(2, 10), 11, 13)
OUTLIER = 4.5  # robust standard deviations
PASSES = 6  # each drops the worst sample of an arc: an outlier pulls its neighbours off, too
LEAST_LEFT = 5


@dataclass(frozen=True)
class Smooth:
    """chi2 (A,) and parameters (A,) of the polynomials of each arc; residual: a list of (n, 3) per arc, in units of
    sigma; fitted: a list of (n, 3), m."""

    degree: int
    chi2: np.ndarray
    parameters: np.ndarray
    residual: list[np.ndarray]
    fitted: list[np.ndarray]


@dataclass(frozen=True)
class NoiseFloor:
    """scale: by how much the noise is larger than stated or first guessed; correlation: of neighbouring samples."""

    scale: float
    correlation: float

    @property
    def information(self) -> float:
        """Independent samples per sample: (1 - r) / (1 + r) of first-order correlated noise."""
        return (1 - self.correlation) / (1 + self.correlation)


def smooth(stack: ArcStack, jumps: Sequence[tuple[Break, ...]]) -> Smooth:
    """The polynomials of a stack's arcs; jumps: of each arc."""
    best: tuple[float, Smooth] | None = None
    for degree in DEGREES:
        chi2, parameters, residual, fitted = [], [], [], []
        for i in range(len(stack)):
            c, k, r, x = _polynomial(stack, i, degree, jumps[i])
            chi2.append(c)
            parameters.append(k)
            residual.append(r)
            fitted.append(x)
        found = Smooth(degree, np.array(chi2), np.array(parameters), residual, fitted)
        count = max(sum(int((r != 0).sum()) for r in residual), 2)
        score = float(count * np.log(max(found.chi2.sum(), 1e-12) / count) + found.parameters.sum() * np.log(count))
        if best is None or score < best[0]:
            best = (score, found)
    assert best is not None
    return best[1]


def _polynomial(
    stack: ArcStack, i: int, degree: int, jumps: Sequence[Break]
) -> tuple[float, int, np.ndarray, np.ndarray]:
    """chi2, number of coefficients, residual (n, 3) in units of sigma and value (n, 3) of one arc."""
    there = stack.weight[i].max(1) > 0
    t = stack.time[i, there]
    span = max(stack.duration[i], 1e-9)
    degree = int(min(degree, max(1, there.sum() - 3 - len(jumps))))
    columns = [np.polynomial.chebyshev.chebvander(2 * t / span - 1, degree)]
    columns += [np.maximum(0, t + stack.start[i] - b.time)[:, None] / span for b in jumps]
    design, weight, x = np.hstack(columns), stack.weight[i, there], stack.position[i, there]
    weights = weight.max(1, keepdims=True)
    beta, *_ = np.linalg.lstsq(design * weights, x * weights, rcond=None)
    value = design @ beta
    residual = (x - value) * weight
    coordinates = int((weight.max(0) > 0).sum())
    return float((residual**2).sum()), design.shape[1] * coordinates, residual, value


def cleaned(stack: ArcStack, jumps: Sequence[tuple[Break, ...]]) -> tuple[ArcStack, Smooth, int]:
    """The stack without outliers: samples far off the polynomials that the others make; and how many there were."""
    dropped = 0
    for _ in range(PASSES):
        found = smooth(stack, jumps)
        sizes = np.concatenate([np.abs(r[r != 0]) for r in found.residual] or [np.zeros(0)])
        if not len(sizes):
            break
        limit = OUTLIER * MAD * float(np.median(sizes)) * _dof_inflation(found)
        weight, bad = stack.weight.copy(), 0
        for i, r in enumerate(found.residual):
            rows = np.flatnonzero(stack.weight[i].max(1) > 0)
            worst = int(np.abs(r).max(1).argmax())
            if np.abs(r[worst]).max() > limit and len(rows) > LEAST_LEFT:
                weight[i, rows[worst]] = 0
                bad += 1
        if not bad:
            break
        dropped += bad
        stack = replace(stack, weight=weight)
    return stack, smooth(stack, jumps), dropped


def _dof_inflation(found: Smooth) -> float:
    count = sum(int((r != 0).sum()) for r in found.residual)
    return float(np.sqrt(count / max(count - found.parameters.sum(), 1)))


def noise_floor(parts: Sequence[Smooth]) -> NoiseFloor:
    """The noise of all arcs together."""
    residuals = [r for part in parts for r in part.residual]
    count = sum(int((r != 0).sum()) for r in residuals)
    parameters = sum(int(part.parameters.sum()) for part in parts)
    chi2 = sum(float(part.chi2.sum()) for part in parts)
    if count <= parameters:
        return NoiseFloor(1.0, 0.0)
    return NoiseFloor(float(np.sqrt(max(chi2, 1e-12) / (count - parameters))), correlation(residuals, parameters))
