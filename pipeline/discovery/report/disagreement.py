"""Where the known scene and the measurements disagree: intervals with the missing force, and their region."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtrc

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import ParameterEstimate, calibrated, standard_errors
from pipeline.discovery.fitting.model import REGION
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.report.localisation import Stretch, normal_z, regime_of
from pipeline.discovery.selection.local_effect import Where, only_of
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.tracks.arc import FAR_AWAY
from pipeline.discovery.where.intervals import is_blow
from pipeline.discovery.where.path_evidence import smooth_velocity


def disagreement(found: Selection) -> list[Stretch]:
    """The intervals in which something unknown acts, the most significant first."""
    where, problem = found.where, found.baseline.problem
    assert where is not None
    fit, out = found.baseline.fit, []
    for stack, start in zip(problem.stacks, fit.starts, strict=True):
        _, nodes = run(stack, fit.model, fit.theta[None], start[None])
        for i, k in enumerate(stack.index):
            intervals = where.of_arc(k)
            if not intervals:
                continue
            arc, step = problem.arcs[k], float(np.median(np.diff(problem.arcs[k].time)))
            velocity = smooth_velocity(arc.time, arc.position)
            for v in intervals:
                middle = (v.start + v.end) / 2
                row = int(np.argmin(np.abs(arc.time - middle)))
                node = int(np.clip((middle - stack.start[i]) / max(stack.duration[i], 1e-9), 0, 1) * stack.steps)
                others = arc.others[row][np.abs(arc.others[row]).max(1) < FAR_AWAY]
                blow = is_blow(v, arc)
                size = stack.mass[i] * (v.end - v.start if blow else 1.0)
                out.append(
                    Stretch(
                        clip=arc.clip,
                        object=arc.object,
                        start=middle - step / 2 if blow else v.start,
                        end=middle + step / 2 if blow else v.end,
                        regime=regime_of(stack, i, velocity[row], nodes.angular_velocity[0, i, node]),
                        force=size * v.acceleration,
                        stderr=float(size * v.error),
                        z=normal_z(v.gain),
                        velocity=velocity[row],
                        towards=others[0] - arc.position[row] if len(others) else None,
                        unit="N s" if blow else "N",
                    )
                )
    return sorted(out, key=lambda s: -s.z)


def clean_numbers(found: Selection) -> dict[str, ParameterEstimate]:
    """The free numbers of the known scene, fitted where it holds; where it holds nowhere, to everything."""
    if found.where is None or not found.where.has_clean_part:
        return calibrated(found.calibration, found.none)
    clean = found.where.clean
    errors = np.sqrt(np.maximum(np.diag(clean.covariance), 0.0))
    return calibrated(found.calibration, found.none, clean.theta, errors)


def _false_discovery_rate(where: Where, told: bool) -> float:
    """The share of the intervals that noise alone would make: each may have any of a path's pairs of ends, unless a law
    has told where they are."""
    parts, chances = [part for own in where.clean.explained for part in own], []
    for part in parts:
        samples = int((np.abs(part.basis).max(1) > 0).sum())
        for v in part.intervals:
            shown = max(int((v.acceleration != 0).sum()), 1)
            choices = 1.0 if told else samples**2 / 2
            chances.append(min(1.0, len(parts) * choices * float(chdtrc(shown, v.gain))))
    return float(np.mean(chances)) if chances else 0.0


def where_dict(found: Selection) -> dict[str, Any] | None:
    """The region as report.json has it; None where the known scene fails nowhere, or in no region."""
    where = found.where
    if where is None or where.region is None:
        return None
    local = any(kind.only is not None for kind in found.answer.fit.model.effects)
    rate = _false_discovery_rate(where, local)
    # a law that holds everywhere explains what disagrees
    if found.answer.effects and not local and found.answer.hits is None:
        return {"only": {}, "objects": None, "share": 1.0, "agreement": 1.0, "false_discovery_rate": rate}
    names = [o.name for o in found.problem.known.scene.objects]
    objects = None if where.region.objects is None else [names[k] for k in where.region.objects]
    return {
        "only": where.region.region.as_dict(),
        "objects": objects,
        "share": where.region.share,
        "agreement": where.region.agreement,
        "false_discovery_rate": rate,
    }


def only_with_errors(found: Candidate, effect: str) -> dict[str, Any] | None:
    """The region in which an effect acts as `Region.as_dict`, each number with its standard error, None where it was
    not fitted; None: everywhere."""
    region = only_of(found, effect)
    if region is None:
        return None
    unknowns = zip(found.fit.model.unknowns, standard_errors(found), strict=True)
    error = {u.name: float(e) for u, e in unknowns if u.owner == f"{REGION}{effect}"}
    parts = {"center": ("centre_x", "centre_y", ""), "normal": ("heading",) * 3}

    def entry(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {k: entry(k, v) for k, v in value.items()}
        if key == "clips":
            return value
        spread = [error.get(part) for part in parts[key]] if key in parts else error.get(key)
        return {"value": value, "stderr": spread}

    return {k: entry(k, v) for k, v in region.as_dict().items()}
