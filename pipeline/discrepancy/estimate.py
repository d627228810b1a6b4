"""Fitted numbers with their standard errors, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.discrepancy.candidate import Candidate
from pipeline.discrepancy.impact import fit_restitution
from pipeline.discrepancy.obstacle import SIZE_SPREAD
from pipeline.discrepancy.select import Selector
from pipeline.scene.effects.kinds.restitution import damping_of
from pipeline.scene.effects.registry import effect_kinds

ENOUGH = 30  # degrees of freedom that tell how large the noise is


@dataclass(frozen=True)
class Estimate:
    """value, stderr: numbers, or lists of the components of a vector; stderr None where nothing determines the
    value."""

    value: float | list[float]
    stderr: float | list[float] | None
    unit: str

    def as_dict(self) -> dict[str, Any]:
        return {"value": self.value, "stderr": self.stderr, "unit": self.unit}


def standard_errors(found: Candidate) -> np.ndarray:
    """Of the fitted numbers, (G,): for the noise that the model itself leaves, and for its correlation."""
    problem = found.problem
    rows = sum(int((s.weight[m] > 0).sum()) for s, m in zip(problem.stacks, problem.chosen, strict=True))
    own = sum(s.own * int((s.samples[m] > 0).sum()) for s, m in zip(problem.stacks, problem.chosen, strict=True))
    freedom = max(rows - own - found.fit.model.size, 1)
    left = sum(float(c[m].sum()) for c, m in zip(found.fit.position_chi2, problem.chosen, strict=True)) / freedom
    noise = left if freedom > ENOUGH else max(left, 1.0)
    return np.sqrt(np.maximum(np.diag(found.fit.covariance), 0) * noise / problem.floor.information)


def effect_estimates(found: Candidate, effect: str) -> dict[str, Estimate]:
    """The parameters of one of a candidate's effects."""
    kind = effect_kinds()[effect]
    if effect == "restitution":
        assert found.restitution is not None
        return {"coefficient": Estimate(found.restitution.coefficient, found.restitution.stderr, "-")}
    if effect == "hidden_obstacle":
        assert found.obstacle is not None
        o = found.obstacle
        return {
            "position": Estimate(_plain(o.position), _plain(o.position_error), "m"),
            "size": Estimate(o.size, o.size_error if o.size_error < SIZE_SPREAD / 2 else None, "m"),
        }
    errors, model = standard_errors(found), found.fit.model
    out: dict[str, Estimate] = {}
    for p in kind.parameters:
        columns = [c for i in range(p.length) if (c := model.column(effect, p.name, i)) is not None]
        values, spread = _plain(found.fit.theta[columns]), _plain(errors[columns])
        out[p.name] = Estimate(values, spread, p.unit) if p.length > 1 else Estimate(values[0], spread[0], p.unit)
    if effect == "anisotropic_friction" and "sliding_friction" in found.problem.known.fit:
        out = _least_ratio(out)
    return out


def _least_ratio(found: dict[str, Estimate]) -> dict[str, Estimate]:
    """Of the two descriptions of one anisotropic friction, where sliding friction is free, that of a ratio up to 1: mu
    along an angle and ratio mu across it is ratio mu along the other angle and mu across that."""
    ratio, angle = found["ratio"], found["angle"]
    assert isinstance(ratio.value, float) and isinstance(angle.value, float) and isinstance(ratio.stderr, float)
    if ratio.value <= 1:
        return found
    turned = angle.value - np.sign(angle.value or 1.0) * np.pi / 2
    return {
        "ratio": Estimate(1 / ratio.value, ratio.stderr / ratio.value**2, ratio.unit),
        "angle": Estimate(float(turned), angle.stderr, angle.unit),
    }


def calibrated(selector: Selector, found: Candidate) -> dict[str, Estimate]:
    """The free parameters of the known scene, `object.parameter`, as fitted with the effects of `found`."""
    known = selector.known
    errors, out = standard_errors(found), {}
    for i, u in enumerate(found.fit.model.unknowns):
        if u.owner.startswith("object:") and u.name in known.fit:
            name = known.scene.objects[int(u.owner.split(":")[1])].name
            determined = errors[i] < 0.5 * u.sigma
            out[f"{name}.{u.name}"] = Estimate(
                float(found.fit.theta[i]), float(errors[i]) if determined else None, u.unit
            )
        elif u.owner == "gravity_error" and "gravity" in known.fit:
            out["gravity"] = Estimate(float(found.fit.theta[i]), float(errors[i]), u.unit)
    if "damping" in known.fit:
        for number, obj in enumerate(known.scene.objects):
            bounce = fit_restitution([b for b in selector.fitter.bounces if b.object == number])
            if bounce is not None:
                value = damping_of(bounce.coefficient)
                slope = abs(damping_of(bounce.coefficient - bounce.stderr) - value)
                out[f"{obj.name}.damping"] = Estimate(value, slope, "-")
    return out


def _plain(values: np.ndarray) -> list[float]:
    return [float(v) for v in values]
