"""A discovery as the content of report.json (docs/formats.md, "Discovery")."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from pipeline.discovery.fitting.estimates import ParameterEstimate, effect_estimates
from pipeline.discovery.report.disagreement import where_dict
from pipeline.discovery.report.discovery import Discovery, Verdict
from pipeline.discovery.report.localisation import Stretch, direction_words
from pipeline.discovery.selection.comparison import Compared, Scored
from pipeline.discovery.selection.gap import Gap
from pipeline.discovery.tracks.noise import MAD
from pipeline.discovery.tracks.problem import Problem

LEAST_ORIENTATIONS = 9  # of an arc, to tell their noise


def report_dict(found: Discovery) -> dict[str, Any]:
    """The discovery as plain numbers, texts, lists and mappings."""
    selection, problem, gap = found.selection, found.problem, found.gap
    names = [o.name for o in problem.known.scene.objects]
    return {
        "noise": {"position_m": problem.sigma, "orientation_rad": _orientation_noise(problem)},
        "clips": {"fitted": list(problem.fitted), "held_out": list(problem.held_out)},
        "calibrated": {k: e.as_dict() for k, e in found.calibrated.items()},
        "disagreement": [_stretch(s, names) for s in found.disagreement],
        "faults": [asdict(f) for f in found.faults],
        "where": where_dict(selection),
        "candidates": candidate_rows(selection, found.probability, effect_estimates),
        "verdict": verdict_dict(found.verdict),
        "gap": gap_dict(gap, "position_rmse_m", "m"),
        "probability_of_none": found.probability["none"],
        "unexplained": {"share": selection.excess_share, "z_score": selection.excess_z},
        "impacts": [
            {"clip": b.clip, "object": names[b.object], "time": b.time, "restitution": b.ratio, "stderr": b.sigma}
            for b in selection.calibration.bounces
        ],
        "notes": list(found.notes),
    }


def _stretch(s: Stretch, names: list[str]) -> dict[str, Any]:
    return {
        "clip": s.clip,
        "object": names[s.object],
        "t_start": s.start,
        "t_end": s.end,
        "regime": str(s.regime),
        "residual": float(np.linalg.norm(s.force)),
        "unit": s.unit,
        "z_score": s.z,
        "direction": direction_words(s),
    }


def gap_dict(gap: Gap, metric: str, unit: str) -> dict[str, Any]:
    """The gap; metric: its name; unit: of its numbers."""
    return {
        "metric": metric,
        "unit": unit,
        "before": gap.before,
        "after": gap.after,
        "noise_floor": gap.noise_floor,
        "clips": list(gap.clips),
    }


def candidate_rows(
    selection: Compared, probability: Mapping[str, float], estimates: Callable[[Any, str], dict[str, ParameterEstimate]]
) -> list[dict[str, Any]]:
    """Every effect alone, and the chosen model, the most probable first.

    Args:
        selection: The models.
        probability: Of each, by the names of its effects.
        estimates: (model, name of an effect) -> its parameters.
    """
    shown = {c.effects: c for c in (*selection.singles, *([selection.chosen] if selection.chosen.effects else []))}
    out = []
    for effects, c in shown.items():
        name = "+".join(effects)
        out.append(
            {
                "effect": name,
                "probability": probability[name],
                "delta_bic": c.bic - selection.none.bic,
                "held_out_gain": (selection.none.held_out - c.held_out) / 2,
                "parameters": _parameters(c, estimates),
            }
        )
    return sorted(out, key=lambda c: -c["probability"])


def _parameters(c: Scored, estimates: Callable[[Any, str], dict[str, ParameterEstimate]]) -> dict[str, Any]:
    several = len(c.effects) > 1
    return {(f"{e}.{k}" if several else k): x.as_dict() for e in c.effects for k, x in estimates(c, e).items()}


def verdict_dict(v: Verdict) -> dict[str, Any]:
    """The answer."""
    out: dict[str, Any] = {
        "effects": list(v.effects),
        "parameters": {k: e.as_dict() for k, e in v.parameters.items()},
        "confidence": v.confidence,
        "equivalent": [list(s) for s in v.equivalent],
        "experiment": v.experiment,
    }
    out["named"] = [
        {
            "effect": n.effect,
            "confidence": n.confidence,
            "share": n.share,
            "parameters": {k: e.as_dict() for k, e in n.parameters.items()},
            **({} if n.only is None else {"only": n.only}),
        }
        for n in v.named
    ]
    out["launch"] = None if v.launch is None else v.launch.as_dict()
    left = v.remainder
    out["remainder"] = None if left is None else asdict(left)
    return out if v.form is None else out | {"form": v.form}


def _orientation_noise(problem: Problem) -> float | None:
    """Standard deviation of measured orientations, rad, from fourth differences of quaternions; None without any."""
    values = []
    for arc in problem.arcs:
        if arc.quaternion is not None and len(arc.quaternion) >= LEAST_ORIENTATIONS:
            q = arc.quaternion * np.sign((arc.quaternion * arc.quaternion[:1]).sum(1, keepdims=True) + 1e-12)
            fourth = np.diff(q, n=4, axis=0)
            values.append(2 * MAD * np.median(np.abs(fourth)) / np.sqrt(70))
    return float(np.median(values)) if values else None
