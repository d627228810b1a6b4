"""The noise of a recording: the residuals of polynomials in time that are fitted to the arcs, without any physics.

The degree is the same for all arcs and chosen by BIC; the polynomials may bend at unexplained velocity jumps. The
residuals tell the size of the noise, whether it is white, and which samples are outliers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.tracks.noise import MAD, correlation
from pipeline.discovery.tracks.smoothing import UNFILTERED, Smoothing
from pipeline.discovery.tracks.stack import ArcStack
from pipeline.discovery.tracks.velocity_jumps import VelocityJump

DEGREES = (*range(2, 10), 11, 13)
OUTLIER = 4.5  # robust standard deviations
PASSES = 6  # each removes the worst sample of an arc: an outlier also shifts the residuals of its neighbours
LEAST_LEFT = 5


@dataclass(frozen=True)
class ArcPolynomials:
    """The polynomials of the arcs of a stack.

    Attributes:
        chi2: (A,) of each arc.
        parameters: (A,) number of coefficients of each arc.
        residual: For each arc (n, 3), in units of sigma.
        fitted: For each arc (n, 3) m.
    """

    chi2: np.ndarray
    parameters: np.ndarray
    residual: list[np.ndarray]
    fitted: list[np.ndarray]


@dataclass(frozen=True)
class NoiseFloor:
    """scale: ratio of the noise to what was stated or first estimated; correlation: of neighbouring samples, where the
    positions were not smoothed; smoothing: where they were."""

    scale: float
    correlation: float
    smoothing: Smoothing = UNFILTERED

    @property
    def information(self) -> float:
        """Independent samples per sample: (1 - r) / (1 + r) for first-order noise, times the filter's."""
        return self.smoothing.information * (1 - self.correlation) / (1 + self.correlation)


def fit_polynomials(
    stack: ArcStack, jumps: Sequence[tuple[VelocityJump, ...]], information: float = 1.0
) -> ArcPolynomials:
    """The polynomials of a stack's arcs.

    jumps: the velocity jumps of each arc. information: independent samples per sample.
    """
    best: tuple[float, ArcPolynomials] | None = None
    for degree in DEGREES:
        chi2, parameters, residual, fitted = [], [], [], []
        for i in range(len(stack)):
            c, k, r, x = _polynomial(stack, i, degree, jumps[i])
            chi2.append(c)
            parameters.append(k)
            residual.append(r)
            fitted.append(x)
        found = ArcPolynomials(np.array(chi2), np.array(parameters), residual, fitted)
        count = max(sum(int((r != 0).sum()) for r in residual) * information, 2)
        score = float(count * np.log(max(found.chi2.sum(), 1e-12) / count) + found.parameters.sum() * np.log(count))
        if best is None or score < best[0]:
            best = (score, found)
    assert best is not None
    return best[1]


def _polynomial(
    stack: ArcStack, i: int, degree: int, jumps: Sequence[VelocityJump]
) -> tuple[float, int, np.ndarray, np.ndarray]:
    """chi2, number of coefficients, residuals (n, 3) in units of sigma and values (n, 3) m of arc i."""
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


def without_outliers(
    stack: ArcStack, jumps: Sequence[tuple[VelocityJump, ...]], information: float
) -> tuple[ArcStack, ArcPolynomials, int]:
    """The stack without the samples that are far from the polynomials through the others; and their number.

    jumps and information: as in `fit_polynomials`.
    """
    dropped = 0
    for _ in range(PASSES):
        found = fit_polynomials(stack, jumps, information)
        sizes = np.concatenate([np.abs(r[r != 0]) for r in found.residual] or [np.zeros(0)])
        if not len(sizes):
            break
        limit = OUTLIER * MAD * float(np.median(sizes)) * _dof_inflation(found, information)
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
    return stack, fit_polynomials(stack, jumps, information), dropped


def _dof_inflation(found: ArcPolynomials, information: float) -> float:
    count = sum(int((r != 0).sum()) for r in found.residual) * information
    return float(np.sqrt(count / max(count - found.parameters.sum(), 1)))


def noise_floor(parts: Sequence[ArcPolynomials]) -> NoiseFloor:
    """The noise floor of all arcs together. parts: the polynomials of each stack."""
    residuals = [r for part in parts for r in part.residual]
    count = sum(int((r != 0).sum()) for r in residuals)
    parameters = sum(int(part.parameters.sum()) for part in parts)
    chi2 = sum(float(part.chi2.sum()) for part in parts)
    if count <= parameters:
        return NoiseFloor(1.0, 0.0)
    return NoiseFloor(float(np.sqrt(max(chi2, 1e-12) / (count - parameters))), correlation(residuals, parameters))
