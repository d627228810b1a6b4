"""Bounces on the ground, by the normal speeds before and after: the restitution they show, and what was expected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.least_squares import Fit
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.tracks.arc import GROUND
from pipeline.discovery.tracks.problem import Problem
from pipeline.scene.effects.contact_damping import SCATTER, restitution_of

LEAST_SPEED = 0.3  # m/s: slower impacts tell little


@dataclass(frozen=True)
class Bounce:
    """An impact with the ground whose speeds are known.

    Attributes:
        clip: Which recording.
        object: Index of the object in the scene.
        time: s.
        before: Normal speed before, m/s (negative).
        after: Normal speed after, m/s.
        sigma: Standard deviation of their ratio, with the scatter of the engine.
        expected: The ratio that the known damping gives.
        fitted: Whether the clip is fitted.
    """

    clip: str
    object: int
    time: float
    before: float
    after: float
    sigma: float
    expected: float
    fitted: bool

    @property
    def ratio(self) -> float:
        """Restitution: normal speed after over normal speed before."""
        return -self.after / self.before


@dataclass(frozen=True)
class RestitutionFit:
    """One restitution for all bounces.

    Attributes:
        coefficient: The restitution.
        stderr: Its standard error.
        chi2: Of the bounces with this restitution.
        chi2_expected: Of the bounces with what the known damping gives, to within `common_error`.
    """

    coefficient: float
    stderr: float
    chi2: float
    chi2_expected: float


def bounces(problem: Problem, found: Fit) -> list[Bounce]:
    """The ground impacts of a problem between two flights that were both fitted."""
    ends = _boundary_speeds(problem, found)
    out = []
    for impact in problem.impacts:
        if impact.other != GROUND or impact.before not in ends or impact.after not in ends:
            continue
        scene = problem.known.of_clip(impact.clip)
        left, right = ends[impact.before], ends[impact.after]
        gravity = scene.gravity[2]
        before = left.last_speed + gravity * (impact.time - left.last_time)
        after = right.first_speed + gravity * (impact.time - right.first_time)
        if before > -LEAST_SPEED or after <= 0:
            continue
        noise = np.hypot(right.error, left.error * after / before) / -before
        out.append(
            Bounce(
                clip=impact.clip,
                object=impact.object,
                time=impact.time,
                before=before,
                after=after,
                sigma=float(np.hypot(noise, SCATTER)),
                expected=restitution_of(scene.objects[impact.object].damping),
                fitted=impact.clip in problem.fitted,
            )
        )
    return out


@dataclass(frozen=True)
class _Ends:
    """Vertical speeds, m/s, at the first and last times, s, of a flight; error: their standard error."""

    first_speed: float
    last_speed: float
    first_time: float
    last_time: float
    error: float


def _boundary_speeds(problem: Problem, found: Fit) -> Mapping[int, _Ends]:
    """Index of an arc -> the ends of the flight."""
    out = {}
    for stack, start in zip(problem.stacks, found.starts, strict=True):
        if stack.grounded:
            continue
        _, nodes = run(stack, found.model, found.theta[None], start[None])
        for i, arc in enumerate(stack.index):
            if not stack.samples[i]:
                continue
            n = max(int(stack.samples[i]), 2)
            sigma = 1 / stack.weight[i].max()
            v = nodes.velocity[0, i, :, 2]
            out[int(arc)] = _Ends(
                first_speed=v[0],
                last_speed=v[-1],
                first_time=stack.start[i],
                last_time=stack.start[i] + stack.duration[i],
                error=sigma * np.sqrt(12 / n) / max(stack.duration[i], 1e-6),
            )
    return out


def common_error(restitution: float) -> float:
    """Standard deviation of the error of a contact damping's restitution that all bounces of a recording share.

    It depends on speed and spin, and is largest where bodies bounce little.
    """
    return 0.03 + 0.08 * max(0.0, 0.5 - restitution)


def fit_restitution(all_bounces: Sequence[Bounce]) -> RestitutionFit | None:
    """One restitution for the bounces of the fitted clips; None without any. The chi2 are of all bounces."""
    fitted = np.array([b.fitted for b in all_bounces], bool)
    if not fitted.any():
        return None
    found, expected, sigma = (
        np.array([getattr(b, key) for b in all_bounces]) for key in ("ratio", "expected", "sigma")
    )
    weight = 1 / sigma**2
    information = float(weight[fitted].sum())
    mean = float((weight * found)[fitted].sum()) / information
    common = common_error(mean)
    shift = float((weight * (found - expected)).sum() / (weight.sum() + common**-2))
    return RestitutionFit(
        coefficient=mean,
        stderr=float(np.hypot(information**-0.5, common)),
        chi2=float((weight * (found - mean) ** 2).sum()),
        chi2_expected=float((weight * (found - expected - shift) ** 2).sum()) + (shift / common) ** 2,
    )
