"""The residual of a model beyond noise, and the arcs that it does not explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.discovery.fitting.calibration import Calibration, bounce_chi2
from pipeline.discovery.fitting.candidate import Candidate, residuals_m
from pipeline.discovery.tracks.noise import correlation
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.tracks.stack import LEAST_FREE

UNEXPLAINED_Z, UNEXPLAINED_SHARE = 5.0, 0.015  # a model explains the data unless both are exceeded
UNEXPLAINED_OF_NOISE = 0.05  # and unless it is this share of the noise: even the best models are slightly wrong
UNEXPLAINED_LOUD = 0.5  # of the noise: too much whatever its share, where there are enough clips
UNEXPLAINED_SHARE_FEW = 0.06  # of one or two clips, whose peculiarities do not average out
LEAST_CLIPS = 3  # fitted clips; fewer differ from each other in too many ways for two effects
DROPPED_Z, DROPPED_SHARE = 6.0, 0.15  # arcs that are so far off, and so few, are dropped
REST_Z = 3.0  # largest excess of the arcs that stay


def excess(calibration: Calibration, found: Candidate) -> tuple[float, float]:
    """Residual of a model beyond noise: as a z-score, and as a share of the calibrated model's."""
    count, none = len(calibration.bounces), calibration.none

    def beyond(c: Candidate) -> tuple[float, float]:
        floor = sum(float(p.chi2.sum()) for p in c.problem.polynomials) / calibration.noise_scale
        smooth = sum(int(p.parameters.sum()) for p in c.problem.polynomials)
        return (c.position_chi2 - floor) * calibration.information, max(smooth - c.parameters, 1)

    left, freedom = beyond(found)
    whole, freedom_none = beyond(none)
    bounce = bounce_chi2(calibration, found) - count * (calibration.restitution is not None)
    z = (left + bounce - freedom) / np.sqrt(2 * (freedom + count))
    whole += bounce_chi2(calibration, none) - freedom_none
    return float(z), float(np.clip((left + max(bounce, 0) - freedom) / max(whole, 1e-9), 0, 1))


def is_unexplained(calibration: Calibration, chosen: Candidate) -> bool:
    """Whether the residual of a model beyond noise is too large for the model to be the answer."""
    z, share = excess(calibration, chosen)
    few = has_few_clips(calibration.problem)
    rest = _share_of_noise(calibration, chosen)
    loud = rest > UNEXPLAINED_LOUD and not few and chosen.hits is None  # undetected outliers may lie near hits
    limit = UNEXPLAINED_SHARE_FEW if few else UNEXPLAINED_SHARE
    return z > UNEXPLAINED_Z and (loud or (share > limit and rest > UNEXPLAINED_OF_NOISE))


def has_few_clips(problem: Problem) -> bool:
    """Whether there are too few fitted clips to average out their peculiarities."""
    return len(problem.fitted) < LEAST_CLIPS


def _share_of_noise(calibration: Calibration, found: Candidate) -> float:
    """Residual of a model beyond noise, as a share of the noise."""
    rows, share = found.problem.rows, found.problem.floor.smoothing.information
    freedom = max(rows - found.parameters / share, LEAST_FREE * (1 - share) * rows, 1)
    left = found.position_chi2 * calibration.noise_scale / freedom - 1
    if calibration.restitution is None:
        return left
    # bounces are few, and each is a measurement
    return max(left, bounce_chi2(calibration, found) / max(len(calibration.bounces), 1) - 1)


def drop_unexplained_arcs(calibration: Calibration, best: Candidate, only_at_impacts: bool = False) -> Problem | None:
    """The problem without the few arcs that the best model misses while it explains all others.

    Such an arc has an impact that was not detected, or an outlier among few samples. The last arcs that are held out
    stay: without them nothing that was not fitted would speak for or against an effect.

    Args:
        calibration: Of the problem.
        best: The best model so far.
        only_at_impacts: Drop only arcs without jumps that an impact begins or ends: the remains of a contact in them
            look like a force that is not there.

    Returns:
        None where there are no such arcs, or too many.
    """
    problem = calibration.problem
    if excess(calibration, best)[0] < UNEXPLAINED_Z or best.hits is not None:
        return None
    touched = {i for impact in problem.impacts for i in (impact.before, impact.after)}
    bad, left, freedom, share = [], 0.0, 0.0, problem.floor.smoothing.information
    for stack, chi2 in zip(problem.stacks, best.fit.position_chi2, strict=True):
        rows = np.maximum(stack.free_rows(share) * share, 1)
        off = (chi2 * problem.floor.information - rows) / np.sqrt(2 * rows) > DROPPED_Z
        if only_at_impacts:
            off &= np.array([i in touched and not problem.arcs[i].jumps for i in stack.index])
        bad.append(off)
        left += float(chi2[~off].sum() * problem.floor.information)
        freedom += float(rows[~off].sum())
    count, arcs = sum(int(b.sum()) for b in bad), sum(map(len, bad))
    rest_z = (left - freedom) / np.sqrt(2 * max(freedom, 1))
    if not 0 < count <= DROPPED_SHARE * (arcs + 2) or rest_z > REST_Z:
        return None
    held = [h & (s.samples > 0) for s, h in zip(problem.stacks, problem.held, strict=True)]
    if any(h.any() for h in held) and not any((h & ~b).any() for h, b in zip(held, bad, strict=True)):
        return None
    stacks = tuple(
        replace(s, weight=np.where(b[:, None, None], 0.0, s.weight)) for s, b in zip(problem.stacks, bad, strict=True)
    )
    polynomials = tuple(
        replace(p, chi2=np.where(b, 0, p.chi2), parameters=np.where(b, 0, p.parameters))
        for p, b in zip(problem.polynomials, bad, strict=True)
    )
    return replace(problem, stacks=stacks, polynomials=polynomials, dropped=problem.dropped + count)


def independent_share(found: Candidate) -> float:
    """Information of a sample relative to one with the noise alone, if a model's residuals are correlated noise."""
    problem = found.problem
    rows = []
    for stack, left in zip(problem.stacks, residuals_m(problem, found), strict=True):
        scaled = left * stack.weight
        there = stack.weight.max(2) > 0
        rows += [scaled[i, there[i]] for i in range(len(stack)) if there[i].any()]
    variance = sum(float((r * r).sum()) for r in rows) / max(problem.rows - problem.own, 1)
    r = correlation(rows, problem.own)
    return float(np.clip((1 - r) / (1 + r) / max(variance, 1.0), 1e-3, 1.0))
