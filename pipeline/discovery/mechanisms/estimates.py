"""Fitted numbers of a mechanism with their standard errors, by name."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.fitting.estimates import DETERMINED, ParameterEstimate
from pipeline.discovery.mechanisms.candidate import Candidate
from pipeline.discovery.mechanisms.kind import Target
from pipeline.discovery.mechanisms.law_model import WEAK

NAME = "name"
"""Unit of the parameter that says on what an effect acts."""


def standard_errors(found: Candidate) -> np.ndarray:
    """Standard errors of the shared numbers, (G,), for noise of the size and correlation of the residuals; NaN of a
    number that nothing determines."""
    size = np.array([u.size for u in found.fit.model.unknowns])
    scale = found.noise.variance / found.noise.information
    errors = np.sqrt(np.maximum(np.diag(found.fit.covariance), 0.0) * scale)
    return np.where((size > 0) & (errors < DETERMINED * WEAK * size), errors, np.nan)


def effect_estimates(found: Candidate, effect: str) -> dict[str, ParameterEstimate]:
    """The parameters of one of a candidate's effects, first on what it acts; `joint.parameter` where it acts on
    several."""
    model, errors = found.fit.model, standard_errors(found)
    acting = [(k, a) for k, a in enumerate(model.acting) if a.kind.name == effect]
    names = [a.place.name for _, a in acting]
    out: dict[str, ParameterEstimate] = {}
    target = acting[0][1].kind.target
    if target is not Target.WORLD:
        out[str(target)] = ParameterEstimate(names[0] if len(names) == 1 else names, None, NAME)
    for k, a in acting:
        owner = f"{a.place.name}." if len(names) > 1 else ""
        for p, (name, part) in zip(a.kind.parameters, model.columns(k).items(), strict=True):
            value, error = [float(v) for v in found.fit.theta[part]], [float(e) for e in errors[part]]
            unsure = not np.isfinite(error).all()
            estimate = ParameterEstimate(
                value if p.length > 1 else value[0],
                None if unsure else error if p.length > 1 else error[0],
                a.kind.unit(p, a.place.slide),
            )
            out[f"{owner}{name}"] = estimate
    return out


def calibrated(found: Candidate) -> dict[str, ParameterEstimate]:
    """The numbers that the user listed as not known."""
    errors = standard_errors(found)
    return {
        n.name: ParameterEstimate(float(v), float(e) if np.isfinite(e) else None, n.unit)
        for n, v, e in zip(found.fit.model.numbers, found.fit.theta, errors, strict=False)
    }
