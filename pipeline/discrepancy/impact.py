"""Impacts with the ground, by the normal speeds before and after: what restitution they show, and what was expected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.arc import Impact
from pipeline.discrepancy.fit import Fit, run
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.stack import ArcStack
from pipeline.scene.effects.kinds.restitution import SCATTER, restitution_of

LEAST_SPEED = 0.3  # m/s: slower impacts say little


@dataclass(frozen=True)
class Bounce:
    """An impact with the ground whose speeds are known. before (negative), after: normal speeds, m/s; sigma: of the
    ratio, engine scatter included; expected: the ratio that the known damping gives; fitted: of a clip that is
    fitted."""

    clip: str
    object: int
    time: float
    before: float
    after: float
    sigma: float
    expected: float
    fitted: bool

    @property
    def restitution(self) -> float:
        return -self.after / self.before


def bounces(
    impacts: Sequence[Impact], stacks: Sequence[ArcStack], found: Fit, known: KnownScene, fitted_clips: frozenset[str]
) -> list[Bounce]:
    """The ground impacts between two flights that were both fitted."""
    ends = _boundary_speeds(stacks, found)
    out = []
    for impact in impacts:
        if impact.other != -1 or impact.before not in ends or impact.after not in ends:
            continue
        left, right = ends[impact.before], ends[impact.after]
        gravity = known.of_clip(impact.clip).gravity[2]
        before = left[1] + gravity * (impact.time - left[3])
        after = right[0] + gravity * (impact.time - right[2])
        if before > -LEAST_SPEED or after <= 0:
            continue
        noise = np.hypot(right[4], left[4] * after / before) / -before
        expected = restitution_of(known.of_clip(impact.clip).objects[impact.object].damping)
        out.append(Bounce(impact.clip, impact.object, impact.time, before, after, float(np.hypot(noise, SCATTER)),
                          expected, impact.clip in fitted_clips))  # fmt: skip
    return out


def _boundary_speeds(stacks: Sequence[ArcStack], found: Fit) -> Mapping[int, tuple[float, float, float, float, float]]:
    """Arc -> vertical speed at its start and end, the times of these, and the standard error of the speeds; flights."""
    out = {}
    for stack, start in zip(stacks, found.starts, strict=True):
        if stack.grounded:
            continue
        _, nodes = run(stack, found.model, found.theta[None], start[None])
        for i, arc in enumerate(stack.index):
            if not stack.samples[i]:
                continue
            n = max(int(stack.samples[i]), 2)
            sigma = 1 / stack.weight[i].max()
            error = sigma * np.sqrt(12 / n) / max(stack.duration[i], 1e-6)
            v = nodes.velocity[0, i, :, 2]
            out[int(arc)] = (v[0], v[-1], stack.start[i], stack.start[i] + stack.duration[i], error)
    return out


@dataclass(frozen=True)
class RestitutionFit:
    """coefficient and its standard error; chi2: of it, and of what the known damping gives, to within
    `common_error`."""

    coefficient: float
    stderr: float
    chi2: float
    chi2_expected: float


def common_error(restitution: float) -> float:
    """By how much the ratio that a contact damping stands for is off for all bounces of a recording alike: it depends
    on the speed and the spin, most where little bounces."""
    return 0.03 + 0.08 * max(0.0, 0.5 - restitution)


def fit_restitution(all_bounces: Sequence[Bounce]) -> RestitutionFit | None:
    """One coefficient for all bounces of the fitted clips; chi2 is of all bounces. None where there are none."""
    fitted = np.array([b.fitted for b in all_bounces], bool)
    if not fitted.any():
        return None
    found, expected, sigma = (
        np.array([getattr(b, key) for b in all_bounces]) for key in ("restitution", "expected", "sigma")
    )
    weight = 1 / sigma**2
    information = float(weight[fitted].sum())
    mean = float((weight * found)[fitted].sum()) / information
    common = common_error(mean)
    shift = float((weight * (found - expected)).sum() / (weight.sum() + common**-2))
    return RestitutionFit(
        mean, float(np.hypot(information**-0.5, common)), float((weight * (found - mean) ** 2).sum()),
        float((weight * (found - expected - shift) ** 2).sum()) + (shift / common) ** 2,
    )  # fmt: skip
