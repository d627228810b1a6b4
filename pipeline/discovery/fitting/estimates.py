"""Fitted parameters with their standard errors, by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.discovery.fitting.bounces import fit_restitution
from pipeline.discovery.fitting.calibration import Calibration
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.model import OBJECT
from pipeline.discovery.tracks.known_scene import SCENE_FITTABLE
from pipeline.scene.effects.contact_damping import damping_of
from pipeline.scene.effects.discovery_rules import Number
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds, kind_of_scene_parameter

ENOUGH_FREEDOM = 30  # degrees of freedom that tell how large the noise is
DETERMINED = 0.5  # of the prior's standard deviation: a number with a larger error is not determined


@dataclass(frozen=True)
class ParameterEstimate:
    """A number, or the components of a vector, with standard errors; or the name of what has them.

    stderr is None where nothing determines the value.
    """

    value: Number | str | list[str]
    stderr: Number | None
    unit: str

    def as_dict(self) -> dict[str, Any]:
        """As in report.json."""
        return {"value": self.value, "stderr": self.stderr, "unit": self.unit}


def standard_errors(found: Candidate) -> np.ndarray:
    """Standard errors of the shared parameters, (G,), for the size and the correlation of the model's own residuals."""
    problem = found.problem
    rows = sum(int((s.weight[m] > 0).sum()) for s, m in zip(problem.stacks, problem.chosen, strict=True))
    own = sum(s.own * int((s.samples[m] > 0).sum()) for s, m in zip(problem.stacks, problem.chosen, strict=True))
    freedom = max(rows - own - found.fit.model.size, 1)
    left = sum(float(c[m].sum()) for c, m in zip(found.fit.position_chi2, problem.chosen, strict=True)) / freedom
    noise = left if freedom > ENOUGH_FREEDOM else max(left, 1.0)
    return np.sqrt(np.maximum(np.diag(found.fit.covariance), 0) * noise / problem.floor.information)


def effect_estimates(found: Candidate, effect: str) -> dict[str, ParameterEstimate]:
    """The parameters of one of a candidate's effects; `object.parameter` where objects have their own."""
    out: dict[str, ParameterEstimate] = {}
    for body, estimates in estimates_by_body(found, effect).items():
        owner = "" if body is None else f"{found.problem.known.scene.objects[body].name}."
        out |= {f"{owner}{name}": estimate for name, estimate in estimates.items()}
    return out


def estimates_by_body(found: Candidate, effect: str) -> dict[int | None, dict[str, ParameterEstimate]]:
    """The parameters of one of a candidate's effects, by the object whose own they are; None: of all objects."""
    kind, model = effect_kinds()[effect], found.fit.model
    if kind.fitted_to_arcs and kind.name not in model.names:  # by convention, with spins that were not measured
        names = [o.name for o in found.problem.known.scene.objects]
        units = {p.name: p.unit for p in kind.parameters}
        return {
            names.index(e.objects[0]) if e.objects and len(names) > 1 else None: {
                name: ParameterEstimate(value, None, units[name]) for name, value in e.parameters
            }
            for e in model.stated
            if e.name == effect
        }
    return {body: _estimates(found, kind, body) for body in model.bodies(effect) or (None,)}


def _estimates(found: Candidate, kind: EffectKind, body: int | None) -> dict[str, ParameterEstimate]:
    model = found.fit.model
    if kind.bounce_ratio is not None:
        assert found.restitution is not None
        (p,) = kind.parameters
        return {p.name: ParameterEstimate(found.restitution.coefficient, found.restitution.stderr, p.unit)}
    if kind.discovery.fit_hits is not None:
        assert found.hits is not None
        hits = found.hits
        return {p.name: ParameterEstimate(hits.values[p.name], hits.errors[p.name], p.unit) for p in kind.parameters}
    errors = standard_errors(found)
    values: dict[str, Number] = {}
    spreads: dict[str, Number] = {}
    for p in kind.parameters:
        columns = model.columns(kind.name, p, body)
        value, spread = ([float(v) for v in array[columns]] for array in (found.fit.theta, errors))
        values[p.name], spreads[p.name] = (value, spread) if p.length > 1 else (value[0], spread[0])
    if kind.discovery.canonical is not None:
        values, spreads = kind.discovery.canonical(values, spreads, found.problem.known.fit)
    return {p.name: ParameterEstimate(values[p.name], spreads[p.name], p.unit) for p in kind.parameters}


def calibrated(
    calibration: Calibration, found: Candidate, theta: np.ndarray | None = None, errors: np.ndarray | None = None
) -> dict[str, ParameterEstimate]:
    """The free parameters of the known scene, `object.parameter`, as fitted with the effects of `found`; or theta (G,)
    with its standard errors (G,)."""
    theta = found.fit.theta if theta is None else theta
    errors = standard_errors(found) if errors is None else errors
    known = calibration.problem.known
    fitted = [parameter for parameter in SCENE_FITTABLE if parameter in known.fit]
    scene_level = {kind.name: p for p in fitted if (kind := kind_of_scene_parameter(p)) is not None}
    out: dict[str, ParameterEstimate] = {}
    for i, u in enumerate(found.fit.model.unknowns):
        if u.owner.startswith(OBJECT) and u.name in known.fit:
            name = known.scene.objects[int(u.owner.removeprefix(OBJECT))].name
            determined = errors[i] < DETERMINED * u.sigma
            out[f"{name}.{u.name}"] = ParameterEstimate(
                float(theta[i]), float(errors[i]) if determined else None, u.unit
            )
        elif u.owner in scene_level:
            out[scene_level[u.owner]] = ParameterEstimate(float(theta[i]), float(errors[i]), u.unit)
    if "damping" in known.fit:
        for number, obj in enumerate(known.scene.objects):
            bounce = fit_restitution([b for b in calibration.bounces if b.object == number])
            if bounce is not None:
                value = damping_of(bounce.coefficient)
                slope = abs(damping_of(bounce.coefficient - bounce.stderr) - value)
                out[f"{obj.name}.damping"] = ParameterEstimate(value, slope, "-")
    return out
