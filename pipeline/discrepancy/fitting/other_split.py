"""Models of one problem, fitted again with another clip held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pipeline.discrepancy.fitting.bounces import bounces, fit_restitution
from pipeline.discrepancy.fitting.calibration import Calibration, fit_model, with_bounces
from pipeline.discrepancy.fitting.candidate import Candidate, with_hits
from pipeline.discrepancy.tracks.problem import hold_out


def hold_out_instead(
    calibration: Calibration, models: Sequence[Candidate], clip: str
) -> tuple[Calibration, tuple[Candidate, ...]] | None:
    """The calibration and some models, fitted to all clips but one; None where the others do not determine them.

    The fits begin where the models' own fits ended.

    Args:
        calibration: Of the problem.
        models: Fitted to it.
        clip: Name of the clip that is held out.
    """
    problem = hold_out(calibration.problem, clip)
    if not any(chosen.any() for chosen in problem.chosen):
        return None
    none = _fitted_again(replace(calibration, problem=problem, restitution=None), calibration.none, clip)
    seen = tuple(bounces(problem, none.fit))
    restitution = None if calibration.restitution is None else fit_restitution(seen)
    if restitution is None and any(model.restitution is not None for model in models):
        return None
    again = Calibration(problem, none, seen, restitution, calibration.noise_scale)
    again = replace(again, none=with_bounces(again, none, False))
    return again, tuple(_fitted_again(again, model, clip) for model in models)


def _fitted_again(calibration: Calibration, model: Candidate, clip: str) -> Candidate:
    problem = hold_out(model.problem, clip)
    found = fit_model(calibration, problem, model.fit.model, model.fit.theta, model.fit.starts, effects=model.effects)
    return with_hits(with_bounces(calibration, found, model.restitution is not None), model.hits, model.hits_price)
